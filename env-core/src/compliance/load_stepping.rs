//! Load stepping of a press: the state of body and shapes, and steps from it.

use nalgebra::{Isometry3, Point3, Vector3};

use super::{
    balance::{Contact, Guess, norm},
    condensed::Condensed,
    newton::Newton,
    reach::{Bound, Reach, bounds},
    solution::{LinearDisplacement, Solution},
    zone::Zone,
};
use crate::{
    Error, Result,
    contact::{
        ContactLaw, ContactStep, DeformedSkin, Touch, backed_off, check_first, engulfs_unfelt,
        holds, is_engulfed,
    },
    deformation::{Anchor, History, Press, Wrench},
    error::StepDefect,
    fem::SolverWorkspace,
    geometry::Shape,
};

/// Distance to a shape within which facets are added to the zone (m).
const MARGIN: f64 = 1e-4;
/// Motion of a shape in one load step beyond which it may run over points that it should press (m).
/// For a thin shape it is half the thickness, if that is less.
const LONG: f64 = 5e-4;
/// Greatest depth by which a shape with edges sinks in within one load step (m). In longer steps a
/// surface point may come nearer to the wrong face of an edge and be pushed out there.
pub(super) const EDGE_STEP: f64 = 2.5e-4;

/// Greatest relative difference between the loads of a linear solution and its contact forces.
const LINEAR: f64 = 1e-3;

/// Settings of a [`LoadStepping`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Settings {
    pub(super) law: ContactLaw,
    /// Greatest number of corrections by the forces of the body's own law.
    pub(super) corrections: usize,
    /// Norm of the residual force at which a step has converged (N).
    pub(super) tolerance: f64,
}

/// Working memory of one thread, reused for successive presses.
pub(crate) struct Scratch {
    pub(super) workspace: SolverWorkspace,
    newton: Newton,
}

impl Scratch {
    pub(super) fn new(condensed: &Condensed) -> Self {
        Self { workspace: condensed.rest.workspace(), newton: Newton::default() }
    }
}

/// A press during load stepping.
pub(super) struct LoadStepping<'a> {
    pub(super) condensed: &'a Condensed,
    pub(super) shapes: &'a [Shape],
    pub(super) settings: Settings,
    pub(super) scratch: &'a mut Scratch,
    reach: Reach,
    pub(super) zone: Zone,
    pub(super) state: Equilibrium,
    /// Wall time of the last frame (s).
    pub(super) seconds: f64,
}

/// State of body and shapes in balance.
pub(super) struct Equilibrium {
    pub(super) poses: Vec<Isometry3<f64>>,
    pub(super) field: LinearDisplacement,
    /// Bounds of the facets (F).
    bounds: Vec<Bound>,
    /// Force of the shapes on the nodes (V) in N.
    pub(super) contact_force: Vec<Vector3<f64>>,
    /// Touches, numbered by the surface points of the whole body.
    touches: Vec<Touch>,
    pub(super) anchors: Vec<Anchor>,
    pub(super) wrench: Wrench,
    /// Share of the normal force that slides.
    pub(super) sliding: f64,
    pub(super) iterations: usize,
}

impl Equilibrium {
    /// Initial guess for a step in which the shapes move to `poses`.
    fn guess(&self, zone: &Zone, poses: &[Isometry3<f64>]) -> Guess {
        let mut forces = zone.pick(&self.field.loads);
        forces.truncate(zone.free);
        let touches = zone.touches_in(&self.touches);
        let motion = |touch: &Touch| {
            let shape = touch.shape as usize;
            poses[shape] * self.poses[shape].inverse_transform_point(&touch.place) - touch.place
        };
        Guess { forces, motion: touches.iter().map(motion).collect(), touches }
    }
}

impl<'a> LoadStepping<'a> {
    /// Begins load stepping where `press` begins.
    pub(super) fn new(
        condensed: &'a Condensed,
        settings: Settings,
        scratch: &'a mut Scratch,
        press: &'a Press,
    ) -> Result<Self> {
        let still = vec![Vector3::zeros(); condensed.rest.places().len()];
        let state = Equilibrium {
            poses: Vec::new(),
            bounds: bounds(condensed, &still),
            field: LinearDisplacement {
                displacement: still.clone(),
                offset: still.clone(),
                loads: still.clone(),
            },
            contact_force: still,
            touches: Vec::new(),
            anchors: Vec::new(),
            wrench: Wrench::default(),
            sliding: 0.0,
            iterations: 0,
        };
        let zone = Zone::new(condensed, vec![false; condensed.facets.len()]);
        scratch.newton.enter(zone.free);
        let (shapes, reach, seconds) = (press.shapes(), Reach::default(), 0.0);
        let mut stepping =
            Self { condensed, shapes, settings, scratch, reach, zone, state, seconds };
        match press.history() {
            Some(history) => stepping.recall(history)?,
            None => stepping.approach(press.drive().first())?,
        }
        Ok(stepping)
    }

    /// Places the shapes at the poses `first`, backed off from the body at rest; returns an error
    /// if one is wholly inside it.
    fn approach(&mut self, first: &[Isometry3<f64>]) -> Result<()> {
        self.cover(first);
        let places = self.zone_places();
        let mesh = self.condensed.body.mesh();
        let still = vec![Vector3::zeros(); mesh.vertices.len()];
        check_first(self.shapes.len(), |i| {
            let (shape, pose) = (&self.shapes[i], &first[i]);
            !holds(shape, pose, &places) && is_engulfed(shape, pose, mesh, &still)
        })?;
        self.state.poses = backed_off(self.shapes, first, &self.zone.surface, &places, mesh);
        Ok(())
    }

    /// Restores the state of a `history`; returns an error if it is of another model.
    fn recall(&mut self, history: &History) -> Result<()> {
        let rest = &self.condensed.rest;
        let points = self.condensed.surface.len();
        history.check(&self.condensed.identity, rest.places().len(), points)?;
        self.state.field.displacement.clone_from(&history.displacement);
        self.state.poses.clone_from(&history.poses);
        self.state.anchors.clone_from(&history.anchors);
        self.state.bounds = bounds(self.condensed, &history.displacement);
        self.cover(&history.poses);
        let places = self.zone_places();
        let anchors = self.zone.anchors_in(&history.anchors);
        let poses = &history.poses;
        let step =
            ContactStep::new(self.shapes, &self.zone.surface, poses.clone(), places, &anchors);
        let (zone, law, newton) = (&self.zone, &self.settings.law, &mut self.scratch.newton);
        let condensed = self.condensed;
        let mut contact = Contact { condensed, zone, law, step, poses, newton };
        let touches = contact.touches(&self.zone.pick(&history.displacement)).unwrap_or_default();
        self.state.contact_force = self.zone.spread(&contact.nodal(&touches), rest.places().len());
        self.state.wrench = contact.wrench(&touches);
        self.state.sliding = contact.sliding(&touches);
        self.state.touches = self.zone.touches_out(touches);
        self.state.field.loads = self.loads(&history.displacement);
        if self.settings.corrections > 0 {
            let given = rest.displacement(&self.state.contact_force, &mut self.scratch.workspace);
            let pairs = history.displacement.iter().zip(given);
            self.state.field.offset = pairs.map(|(u, given)| u - given).collect();
        }
        Ok(())
    }

    /// Nodal forces that cause `displacement` (V) in N: the contact forces there. Since a small
    /// residual force displaces a free body by about a hundredth of a millimetre, its nodal forces
    /// are computed from the displacement, if that is a linear solution.
    fn loads(&mut self, displacement: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let contact = &self.state.contact_force;
        let workspace = &mut self.scratch.workspace;
        let Some(loads) = self.condensed.rest.loads_of_free(displacement, workspace) else {
            return contact.clone();
        };
        let apart: Vec<_> = loads.iter().zip(contact).map(|(a, b)| a - b).collect();
        if norm(&apart) < LINEAR * norm(contact) { loads } else { contact.clone() }
    }

    /// Attempts one load step to `poses` and returns the state it ends in.
    pub(super) fn attempt(&mut self, poses: &[Isometry3<f64>]) -> Result<Equilibrium> {
        if self.runs_over(poses) {
            return Err(Error::StepTooLong { defect: StepDefect::PassedSurface });
        }
        let shapes = self.shapes;
        let most = self.settings.law.deep();
        self.condensed.backing.check(shapes, [&self.state.poses, poses], most)?;
        self.cover(poses);
        loop {
            let state = self.attempt_in_zone(poses)?;
            let near = self.reach.reached(shapes, poses, &state.bounds, 0.0);
            let displacement = &state.field.displacement;
            match self.zone.grown(self.condensed, shapes, poses, displacement, &near) {
                Some(facets) => self.enter_zone(facets),
                None if self.engulfs_unfelt(&state) => {
                    return Err(Error::StepTooLong { defect: StepDefect::Engulfed });
                }
                None => return Ok(state),
            }
        }
    }

    /// Returns whether a shape that touches nothing is wholly inside the body.
    fn engulfs_unfelt(&self, state: &Equilibrium) -> bool {
        let felt = |s| state.touches.iter().any(|touch| touch.shape == s);
        let (mesh, displacement) = (self.condensed.body.mesh(), &state.field.displacement);
        engulfs_unfelt(self.shapes, &state.poses, felt, mesh, displacement)
    }

    /// Returns an error if a shape pierces the skin at the end of a frame of `press`.
    pub(super) fn check_skin(&self, press: &Press) -> Result<()> {
        let (state, zone, law) = (&self.state, &self.zone, &self.settings.law);
        let mut pushes = vec![Vector3::zeros(); self.shapes.len()];
        for touch in &state.touches {
            let point = &self.condensed.surface[touch.point as usize];
            pushes[touch.shape as usize] += law.force(point, touch);
        }
        let displacement = zone.pick(&state.field.displacement);
        let mesh = self.condensed.body.mesh();
        let skin = DeformedSkin::new(mesh, &zone.surface, &zone.places, &displacement);
        skin.check(self.shapes, &state.poses, &pushes, press.begins_at(&state.poses))
    }

    /// Returns whether a shape that moves far to `poses` passes over points that it should have
    /// pressed.
    fn runs_over(&self, poses: &[Isometry3<f64>]) -> bool {
        let (shapes, from) = (self.shapes, &self.state.poses);
        let motion = |(from, to): (&Isometry3<f64>, &Isometry3<f64>)| {
            (to.translation.vector - from.translation.vector).norm()
        };
        let long = |shape: &Shape| f64::min(LONG, 0.5 * shape.thickness());
        let mut motions = from.iter().zip(poses).map(motion).zip(shapes);
        if motions.all(|(motion, shape)| motion < long(shape)) {
            return false;
        }
        let (rest, displacement) = (&self.condensed.rest, &self.state.field.displacement);
        let surface = &self.condensed.surface;
        let places = surface.iter().map(|point| point.place(rest.places(), displacement)).collect();
        ContactStep::new(shapes, surface, from.clone(), places, &[])
            .runs_over(poses, self.settings.law.deep())
    }

    /// Attempts the step of [`LoadStepping::attempt`] with contact in the present zone only.
    fn attempt_in_zone(&mut self, poses: &[Isometry3<f64>]) -> Result<Equilibrium> {
        let start = self.zone_places();
        let anchors = self.zone.anchors_in(&self.state.anchors);
        let from = self.state.poses.clone();
        let zone = &self.zone;
        let step = ContactStep::new(self.shapes, &zone.surface, from, start, &anchors);
        let (condensed, law, newton) =
            (self.condensed, &self.settings.law, &mut self.scratch.newton);
        let mut contact = Contact { condensed, zone, law, step, poses, newton };
        let mut solution = Solution {
            condensed: self.condensed,
            workspace: &mut self.scratch.workspace,
            contact: &mut contact,
            tolerance: self.settings.tolerance,
            iterations: 0,
        };
        let guess = self.state.guess(zone, poses);
        let (field, touches) =
            solution.find(&self.state.field.offset, guess, self.settings.corrections)?;
        let iterations = solution.iterations;
        let law = &self.settings.law;
        let displaced = zone.pick(&field.displacement);
        if contact.step.goes_through(poses, &places(zone, &displaced), law.deep()) {
            return Err(Error::StepTooLong { defect: StepDefect::PassedSurface });
        }
        let back = |touch: &_| stuck_at(law, zone, touch);
        let anchors = zone.anchors_out(contact.step.anchors(poses, &touches, back));
        let contact_force = zone.spread(&contact.nodal(&touches), field.displacement.len());
        let (wrench, sliding) = (contact.wrench(&touches), contact.sliding(&touches));
        let touches = zone.touches_out(touches);
        let poses = poses.to_vec();
        let bounds = bounds(self.condensed, &field.displacement);
        Ok(Equilibrium {
            poses,
            field,
            bounds,
            contact_force,
            touches,
            anchors,
            wrench,
            sliding,
            iterations,
        })
    }

    /// Replaces the zone, if needed, by one with all facets that the shapes at `poses` may touch.
    pub(super) fn cover(&mut self, poses: &[Isometry3<f64>]) {
        let (shapes, bounds) = (self.shapes, &self.state.bounds);
        if !self.zone.covers(&self.reach.reached(shapes, poses, bounds, 0.0)) {
            let near = self.reach.reached(shapes, poses, bounds, MARGIN);
            self.enter_zone(near);
        }
    }

    fn enter_zone(&mut self, facets: Vec<bool>) {
        self.zone = Zone::new(self.condensed, facets);
        self.scratch.newton.enter(self.zone.free);
    }

    /// Positions of the zone's surface points.
    pub(super) fn zone_places(&self) -> Vec<Point3<f64>> {
        places(&self.zone, &self.zone.pick(&self.state.field.displacement))
    }
}

/// Positions of the zone's surface points with its nodes displaced (m).
fn places(zone: &Zone, displacement: &[Vector3<f64>]) -> Vec<Point3<f64>> {
    zone.surface.iter().map(|point| point.place(&zone.places, displacement)).collect()
}

fn stuck_at(law: &ContactLaw, zone: &Zone, touch: &Touch) -> Vector3<f64> {
    law.stuck_at(&zone.surface[touch.point as usize], touch)
}
