//! Linear elasticity of a body, condensed once to its surface.
//!
//! The stiffness is that of the finite elements at rest ([`crate::fem`], `p1-bar`), reduced to a
//! dense compliance matrix between the nodes of the surface. Contact has the same surface points,
//! law and history as there ([`crate::contact`]), and a press may continue from a history of either
//! model. Large strain is neglected, unless [`ComplianceOptions::corrections`] are asked for: each
//! is a step of modified Newton with the stiffness at rest and the forces of the body's own law. It
//! is accepted only if it lowers the residual force, which
//! [`Deformation::residual`](crate::deformation::Deformation) reports.
//!
//! A body is held by fixed nodes, or is free ([`Compliance::free`]) and held by contact alone.
//!
//! [`nodal`] solves contact faster: at the nodes of the surface or, of a pad, on grids of cells that
//! are as small as the contact needs.

mod balance;
mod cache;
mod condensed;
mod descent;
mod mixing;
mod newton;
pub mod nodal;
mod path;
mod preconditioner;
mod push;
mod reach;
mod solution;
mod load_stepping;
mod zone;

use std::{path::Path, sync::Arc};

use rayon::prelude::*;

use crate::{
    Error, Result,
    contact::ContactLaw,
    deformation::{Deformation, DeformationModel, Press, SoftBody, Wanted},
    fem::FemOptions,
    interrupt::Interrupt,
};

use condensed::Condensed;
pub(crate) use load_stepping::Scratch;
use load_stepping::{LoadStepping, Settings};

/// Settings of a [`Compliance`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ComplianceOptions {
    /// Coefficient of Coulomb friction between body and shapes.
    pub friction: f64,
    /// Greatest number of corrections of a load step by the forces of the body's own law, 0 to 12;
    /// with 0 the body is linearly elastic.
    pub corrections: usize,
}

/// Greatest number of corrections allowed.
const MOST_CORRECTIONS: usize = 12;

/// Compliance model of one soft body. Copies share the precomputed data.
#[derive(Clone)]
pub struct Compliance {
    condensed: Arc<Condensed>,
    settings: Settings,
}

impl Compliance {
    /// Condenses `body`; returns an error if its fixed nodes do not hold it.
    pub fn new(body: SoftBody, options: ComplianceOptions) -> Result<Self> {
        Self::condensed(body, options, None)
    }

    /// Condenses a `body` without fixed nodes. Springs at its nodes, a ten-thousandth as stiff as
    /// the body, tie it to its rest position and bear the contact forces that are not balanced. The
    /// model has fewer contact points than the finite-element model, so neither can continue from
    /// the other's history.
    pub fn free(body: SoftBody, options: ComplianceOptions) -> Result<Self> {
        let settings = settings(&body, options)?;
        Ok(Self { condensed: Arc::new(Condensed::free(body)?), settings })
    }

    /// Returns [`Compliance::new`] with the compliance read from a file in `directory`; the file is
    /// written if it is missing, damaged or of another body.
    pub fn cached(body: SoftBody, options: ComplianceOptions, directory: &Path) -> Result<Self> {
        Self::condensed(body, options, Some(directory))
    }

    fn condensed(
        body: SoftBody,
        options: ComplianceOptions,
        directory: Option<&Path>,
    ) -> Result<Self> {
        let settings = settings(&body, options)?;
        Ok(Self { condensed: Arc::new(Condensed::new(body, directory)?), settings })
    }

    /// The body.
    pub fn body(&self) -> &SoftBody {
        &self.condensed.body
    }

    /// Solves every frame of `press`, in order; the first that fails is an error and the last.
    pub fn solve_path(&self, press: &Press) -> Vec<Result<Deformation>> {
        let mut scratch = Scratch::new(&self.condensed);
        let condensed = match self.condensed.suited(press) {
            Ok(condensed) => condensed,
            Err(error) => return vec![Err(error)],
        };
        match LoadStepping::new(&condensed, self.settings_of(press), &mut scratch, press) {
            Ok(stepping) => stepping.every(press, whole),
            Err(error) => vec![Err(error)],
        }
    }

    /// Solves the last frame of `press`; its residual is 0 unless `with_residual`.
    pub(crate) fn last(
        &self,
        press: &Press,
        with_residual: bool,
        scratch: &mut Scratch,
    ) -> Result<Deformation> {
        let condensed = self.condensed.suited(press)?;
        let stepping = LoadStepping::new(&condensed, self.settings_of(press), scratch, press)?;
        let report = if with_residual { LoadStepping::report } else { LoadStepping::stressed };
        stepping.last(press, report)
    }

    /// Working memory for [`Compliance::last`], reused for successive presses.
    pub(crate) fn scratch(&self) -> Scratch {
        Scratch::new(&self.condensed)
    }

    /// Settings with the friction of `press`.
    fn settings_of(&self, press: &Press) -> Settings {
        let mut settings = self.settings;
        settings.law.friction = press.friction().unwrap_or(settings.law.friction);
        settings
    }

    /// Solves each press to its end and returns the result of `report` there. Presses are solved in
    /// parallel, each on one thread.
    fn each<T: Send>(
        &self,
        presses: &[Press],
        report: impl Fn(&mut LoadStepping) -> Result<T> + Sync,
    ) -> Vec<Result<T>> {
        let interrupt = Interrupt::current();
        let scratch = || Scratch::new(&self.condensed);
        let answer = |scratch: &mut Scratch, press: &Press| {
            let condensed = self.condensed.suited(press)?;
            let stepping = LoadStepping::new(&condensed, self.settings_of(press), scratch, press)?;
            interrupt.during(|| stepping.last(press, &report))
        };
        presses.par_iter().map_init(scratch, answer).collect()
    }
}

impl DeformationModel for Compliance {
    fn solve(&self, presses: &[Press]) -> Vec<Result<Deformation>> {
        self.each(presses, whole)
    }

    fn solve_partially(&self, presses: &[Press], wanted: Wanted) -> Vec<Result<Deformation>> {
        if wanted == Wanted::default() {
            self.each(presses, |stepping| Ok(stepping.unstressed()))
        } else {
            self.solve(presses)
        }
    }

    fn solve_path(&self, press: &Press) -> Vec<Result<Deformation>> {
        self.solve_path(press)
    }
}

fn whole(stepping: &mut LoadStepping) -> Result<Deformation> {
    stepping.report()
}

fn settings(body: &SoftBody, options: ComplianceOptions) -> Result<Settings> {
    if options.corrections > MOST_CORRECTIONS {
        return Err(Error::invalid(
            "corrections",
            options.corrections,
            format!("0 to {MOST_CORRECTIONS}"),
        ));
    }
    let of_elements = FemOptions::default();
    let law = ContactLaw::new(of_elements.softness, options.friction)?;
    let tolerance = of_elements.tolerance_for(body);
    Ok(Settings { law, corrections: options.corrections, tolerance })
}
