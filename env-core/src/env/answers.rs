//! The one call in which a model answers all presses.

use std::panic::{AssertUnwindSafe, catch_unwind};

use rayon::{ThreadPool, prelude::*};

use crate::{
    Error, Result,
    deformation::{Deformation, DeformationModel, Press, Wanted},
    tactile::{Model, SoftObject},
};

/// What `model` answers to `presses`, as far as it is `wanted`, on the threads of `pool` or where it is
/// called. A panic in one press is that one's error.
pub(super) fn answers(
    model: &mut Model,
    presses: &[Press],
    wanted: Wanted,
    pool: Option<&ThreadPool>,
) -> Vec<Result<Deformation>> {
    match pool {
        Some(pool) => pool.install(|| each(model, presses, wanted)),
        None => each(model, presses, wanted),
    }
}

fn each(model: &mut Model, presses: &[Press], wanted: Wanted) -> Vec<Result<Deformation>> {
    let mut solve = |presses| catch_unwind(AssertUnwindSafe(|| model.feel(presses, wanted)));
    solve(presses).unwrap_or_else(|_| {
        let mut alone =
            |press| solve(std::slice::from_ref(press)).ok().and_then(|mut one| one.pop());
        presses.iter().map(|press| alone(press).unwrap_or(Err(Error::Panicked))).collect()
    })
}

/// What each of the soft `objects` answers to its press, as [`answers`]; a row without its object is an
/// error.
pub(super) fn answers_of_objects(
    objects: &[Option<&SoftObject>],
    presses: &[Press],
    pool: Option<&ThreadPool>,
) -> Vec<Result<Deformation>> {
    let one = |(object, press): (Option<&SoftObject>, &Press)| {
        let mut model = object.ok_or(Error::Panicked)?.model().clone();
        let solve = || model.solve(std::slice::from_ref(press)).pop();
        catch_unwind(AssertUnwindSafe(solve)).ok().flatten().unwrap_or(Err(Error::Panicked))
    };
    let all = || objects.par_iter().copied().zip(presses).map(one).collect();
    match pool {
        Some(pool) => pool.install(all),
        None => all(),
    }
}
