//! Solves the presses of all rows in one call to a model.

use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    slice,
};

use rayon::{ThreadPool, prelude::*};

use crate::{
    Error, Result,
    deformation::{Deformation, Press, Wanted},
    geometry::TetMesh,
    interrupt::Interrupt,
    tactile::TactileModel,
};

/// Result of a press.
pub(super) struct Answer {
    pub(super) found: Result<Deformation>,
    /// Kind of the error ([`Error::kind`]) of the whole press, if `found` is the solution of its
    /// last pose from rest instead; the history of the contact is then lost.
    pub(super) restarted: Option<&'static str>,
}

/// Solves `presses` by `model`, each at contact with the object of that index in `objects`, with
/// the optional parts `wanted`, on the threads of `pool` or of the caller. A panic in one press
/// becomes the error of that press.
pub(super) fn answers(
    model: &TactileModel,
    objects: &[usize],
    presses: &[Press],
    wanted: Wanted,
    pool: Option<&ThreadPool>,
) -> Vec<Answer> {
    let ask = |which: &[usize], presses: &[Press]| {
        let objects: Vec<_> = which.iter().map(|&i| objects[i]).collect();
        let found = each(model, &objects, presses, wanted);
        match model.pads().and_then(|pads| pads.model().linear_body()) {
            Some(body) => {
                let (mesh, thickness) = (body.mesh(), body.mesh().height());
                let pairs = found.into_par_iter().zip(presses);
                pairs.map(|(found, press)| plausible(found?, press, mesh, thickness)).collect()
            }
            None => found,
        }
    };
    let interrupt = Interrupt::current();
    match pool {
        Some(pool) => pool.install(|| interrupt.during(|| restarted(presses, ask))),
        None => restarted(presses, ask),
    }
}

/// Solves the presses by `ask`, which receives their indices with them. A press that fails is
/// solved again from rest with only its last pose ([`Press::final_frame`]).
fn restarted(
    presses: &[Press],
    ask: impl Fn(&[usize], &[Press]) -> Vec<Result<Deformation>>,
) -> Vec<Answer> {
    let all: Vec<_> = (0..presses.len()).collect();
    let plain = |found| Answer { found, restarted: None };
    let mut answers: Vec<_> = ask(&all, presses).into_iter().map(plain).collect();
    let failed = |&i: &usize| {
        let kind = answers[i].found.as_ref().err()?.kind();
        Some((i, kind, presses[i].final_frame()?))
    };
    let failed: Vec<_> = all.iter().filter_map(failed).collect();
    if failed.is_empty() {
        return answers;
    }
    let (rows, ends): (Vec<_>, Vec<_>) = failed.iter().map(|(i, _, end)| (*i, end.clone())).unzip();
    for ((i, kind, _), found) in failed.into_iter().zip(ask(&rows, &ends)) {
        if found.is_ok() {
            answers[i] = Answer { found, restarted: Some(kind) };
        }
    }
    answers
}

/// Marks the history of an answer to `press` if its displacement turns a tetrahedron of `mesh`
/// inside out. It is an error if that of the answer before did so, too, or if a node is displaced by
/// more than the `thickness` of the gel (m).
///
/// With linear elasticity a shape can carry the skin over its edge and hold it there with its side,
/// step after step, or drag it along without limit; contact solved from rest is then nearer to the
/// truth.
fn plausible(
    mut answer: Deformation,
    press: &Press,
    mesh: &TetMesh,
    thickness: f64,
) -> Result<Deformation> {
    if answer.displacement.iter().any(|u| u.norm_squared() > thickness * thickness) {
        return Err(Error::Inverted);
    }
    answer.history.folded = mesh.is_folded_by(&answer.displacement);
    let was_folded = press.history().is_some_and(|before| before.folded);
    if answer.history.folded && was_folded { Err(Error::Inverted) } else { Ok(answer) }
}

fn each(
    model: &TactileModel,
    objects: &[usize],
    presses: &[Press],
    wanted: Wanted,
) -> Vec<Result<Deformation>> {
    let solve = |objects: &[usize], presses: &[Press]| {
        catch_unwind(AssertUnwindSafe(|| model.solve_partially(objects, presses, wanted)))
    };
    solve(objects, presses).unwrap_or_else(|_| {
        let alone = |(object, press)| {
            let one = solve(slice::from_ref(object), slice::from_ref(press)).ok();
            one.and_then(|mut one| one.pop()).unwrap_or(Err(Error::Panicked))
        };
        objects.iter().zip(presses).map(alone).collect()
    })
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Vector3};

    use super::*;
    use crate::{
        deformation::{DeformationModel, History, history::tests::foreign},
        geometry::Shape,
        tactile::{Choice, Resolution, TactileConfig, TactilePad},
    };

    /// Linear model of a coarse pad.
    fn coarse() -> TactilePad {
        let resolution = Resolution { nodes: 100, ..Resolution::default() };
        let config =
            TactileConfig { choice: Choice::Compliance, resolution, ..TactileConfig::default() };
        TactilePad::new(&config).unwrap().unwrap()
    }

    #[test]
    fn a_path_that_fails_is_solved_from_rest_at_its_final_frame() {
        let model = TactileModel::Pads(coarse());
        let radius = 8e-3;
        let at = |depth: f64| vec![Isometry3::translation(0.0, 0.0, radius - depth)];
        let press = Press::along(vec![Shape::Sphere { radius }], vec![at(3e-4)]).unwrap();
        // A history that fits no body.
        let displacement = vec![Vector3::zeros(); 3];
        let poses = at(-1e-3);
        let history = History {
            model: foreign(),
            displacement,
            poses,
            anchors: Vec::new(),
            forces: Vec::new(),
            folded: false,
        };
        let asked = [press.clone(), press.after(history).unwrap()];
        let [straight, lost] =
            answers(&model, &[0, 0], &asked, Wanted::default(), None).try_into().ok().unwrap();
        assert_eq!([straight.restarted, lost.restarted], [None, Some("invalid")]);
        let forces = [straight, lost].map(|answer| answer.found.unwrap().contact_force);
        assert!(forces[0].iter().any(|force| force.norm() > 0.0));
        assert_eq!(forces[0], forces[1]);
    }

    #[test]
    fn an_answer_that_folds_twice_is_an_error() {
        let pad = coarse();
        let model = pad.model();
        let radius = 8e-3;
        let pose = Isometry3::translation(0.0, 0.0, radius - 3e-4);
        let press = Press::along(vec![Shape::Sphere { radius }], vec![vec![pose]]).unwrap();
        let flat = model
            .solve_partially(std::slice::from_ref(&press), Wanted::default())
            .remove(0)
            .unwrap();
        let mesh = model.linear_body().unwrap().mesh().clone();
        let checked = |answer, press: &Press| plausible(answer, press, &mesh, f64::INFINITY);
        let mut folded = flat.clone();
        // A corner pushed through the opposite side.
        let [a, b, c, d] = mesh.corners(0).map(|corner| corner.coords);
        folded.displacement[mesh.tets[0][0] as usize] += 1.1 * ((b + c + d) / 3.0 - a);
        let flat = checked(flat, &press).unwrap();
        let once = checked(folded.clone(), &press).unwrap();
        assert_eq!([flat.history.folded, once.history.folded], [false, true]);
        let again = press.clone().after(once.history).unwrap();
        assert_eq!(checked(folded.clone(), &again).unwrap_err(), Error::Inverted);
        let mended = press.after(flat.history).unwrap();
        assert!(checked(folded, &mended).is_ok());
    }

    #[test]
    fn an_answer_that_moves_farther_than_the_gel_is_thick_is_an_error() {
        let pad = coarse();
        let mesh = pad.model().linear_body().unwrap().mesh();
        let pose = vec![Isometry3::translation(0.0, 0.0, 8e-3 - 3e-4)];
        let press = Press::along(vec![Shape::Sphere { radius: 8e-3 }], vec![pose]).unwrap();
        let presses = slice::from_ref(&press);
        let near = pad.model().solve_partially(presses, Wanted::default()).remove(0).unwrap();
        let moved = |share: f64| {
            let mut answer = near.clone();
            answer.displacement.fill(Vector3::new(0.0, share * mesh.height(), 0.0));
            plausible(answer, &press, mesh, mesh.height()).map(|_| ())
        };
        assert_eq!([moved(0.99), moved(1.01)], [Ok(()), Err(Error::Inverted)]);
    }
}
