//! A press walked frame by frame: load steps and their subdivision.

use std::time::Instant;

use nalgebra::{Isometry3, Point3, Vector3};

use super::{
    balance::{Contact, Guess, norm},
    condensed::Condensed,
    push::push,
    solution::{Field, Solution},
    zone::{Zone, reached},
};
use crate::{
    Error, Result,
    contact::{ContactLaw, ContactStep, Touch, backed_off, between, clearance},
    deformation::{Anchor, Deformation, Drive, History, Press, Wrench},
    fem::Workspace,
    geometry::Shape,
};

/// Smallest part of a frame that is tried as a load step of its own.
const SHORTEST_STRIDE: f64 = 1.0 / 64.0;
/// Farthest that a shape with edges sinks in within one load step (m): a point of the surface that is
/// nearer to the wrong face of an edge would be pushed out there.
pub(super) const EDGE_STRIDE: f64 = 2.5e-4;
/// Facets this close to a shape are made part of the zone (m).
const MARGIN: f64 = 2e-4;

/// How a walk computes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Settings {
    pub(super) law: ContactLaw,
    /// Corrections by the true residual.
    pub(super) sweeps: usize,
    /// Norm of the unbalanced force that needs no further work (N).
    pub(super) tolerance: f64,
}

/// One press being answered.
pub(super) struct Walk<'a> {
    condensed: &'a Condensed,
    settings: Settings,
    workspace: Workspace,
    zone: Zone,
    pub(super) state: State,
}

/// Body and shapes in balance.
pub(super) struct State {
    pub(super) poses: Vec<Isometry3<f64>>,
    field: Field,
    /// Force of the shapes on the nodes (V) in N.
    contact_force: Vec<Vector3<f64>>,
    /// Touches, by points of the mesh.
    touches: Vec<Touch>,
    anchors: Vec<Anchor>,
    pub(super) wrench: Wrench,
    pub(super) iterations: usize,
}

impl State {
    /// What it makes expect when the shapes move on to `poses`.
    fn guess(&self, zone: &Zone, poses: &[Isometry3<f64>]) -> Guess {
        let mut forces = zone.pick(&self.contact_force);
        forces.truncate(zone.free);
        let touches = zone.touches_in(&self.touches);
        let motion = |touch: &Touch| {
            let shape = touch.shape as usize;
            poses[shape] * self.poses[shape].inverse_transform_point(&touch.place) - touch.place
        };
        Guess { forces, motion: touches.iter().map(motion).collect(), touches }
    }
}

impl<'a> Walk<'a> {
    /// A walk that begins where `press` does.
    pub(super) fn new(condensed: &'a Condensed, settings: Settings, press: &Press) -> Result<Self> {
        let still = vec![Vector3::zeros(); condensed.rest.places().len()];
        let state = State {
            poses: Vec::new(),
            field: Field { displacement: still.clone(), offset: still.clone() },
            contact_force: still,
            touches: Vec::new(),
            anchors: Vec::new(),
            wrench: Wrench::default(),
            iterations: 0,
        };
        let zone = Zone::new(condensed, vec![false; condensed.facets.len()]);
        let workspace = condensed.rest.workspace();
        let mut walk = Self { condensed, settings, workspace, zone, state };
        match press.history() {
            Some(history) => walk.recall(press.shapes(), history)?,
            None => walk.approach(press),
        }
        Ok(walk)
    }

    /// Puts the shapes beside the resting body.
    fn approach(&mut self, press: &Press) {
        let first = match press.drive() {
            Drive::Translation { path } => &path[0],
            Drive::Force { poses, .. } => poses,
        };
        self.cover(press.shapes(), first);
        let places = self.zone_places();
        self.state.poses = backed_off(press.shapes(), first, &self.zone.surface, &places);
    }

    /// Goes back to where another press ended.
    fn recall(&mut self, shapes: &[Shape], history: &History) -> Result<()> {
        let rest = &self.condensed.rest;
        history.check(rest.places().len(), rest.surface().len())?;
        self.state.field.displacement.clone_from(&history.displacement);
        self.state.poses.clone_from(&history.poses);
        self.state.anchors.clone_from(&history.anchors);
        self.cover(shapes, &history.poses);
        let places = self.zone_places();
        let anchors = self.zone.anchors_in(&history.anchors);
        let poses = &history.poses;
        let step = ContactStep::new(shapes, &self.zone.surface, poses.clone(), places, &anchors);
        let mut contact = Contact { zone: &self.zone, law: &self.settings.law, step, poses };
        let touches = contact.touches(&self.zone.pick(&history.displacement)).unwrap_or_default();
        self.state.contact_force = self.zone.spread(&contact.nodal(&touches), rest.places().len());
        self.state.wrench = contact.wrench(&touches);
        self.state.touches = self.zone.touches_out(touches);
        if self.settings.sweeps > 0 {
            let given = rest.displacement(&self.state.contact_force, &mut self.workspace);
            let pairs = history.displacement.iter().zip(given);
            self.state.field.offset = pairs.map(|(u, given)| u - given).collect();
        }
        Ok(())
    }

    /// The frames of `press`, of which the last alone is reported if `every` is false; the first
    /// that fails is the last.
    pub(super) fn frames(mut self, press: &Press, every: bool) -> Vec<Result<Deformation>> {
        let path = match press.drive() {
            Drive::Translation { path } => path,
            Drive::Force { force, direction, .. } => {
                let pushed = |walk: &mut Self| push(walk, press.shapes(), *force, direction);
                return vec![self.frame(pushed)];
            }
        };
        let mut frames = Vec::with_capacity(path.len());
        for (i, poses) in path.iter().enumerate() {
            if every || i + 1 == path.len() {
                frames.push(self.frame(|walk| walk.follow(press.shapes(), poses)));
            } else if let Err(error) = self.follow(press.shapes(), poses) {
                frames.push(Err(error));
            }
            if frames.last().is_some_and(Result::is_err) {
                break;
            }
        }
        frames
    }

    /// Wrench of every frame of `press`; the first that fails is the last.
    pub(super) fn wrenches(mut self, press: &Press) -> Vec<Result<Wrench>> {
        let shapes = press.shapes();
        match press.drive() {
            Drive::Translation { path } => {
                let mut wrenches = Vec::with_capacity(path.len());
                for poses in path {
                    wrenches.push(self.follow(shapes, poses).map(|()| self.state.wrench));
                    if wrenches.last().is_some_and(Result::is_err) {
                        break;
                    }
                }
                wrenches
            }
            Drive::Force { force, direction, .. } => {
                vec![push(&mut self, shapes, *force, direction).map(|()| self.state.wrench)]
            }
        }
    }

    /// Solves one frame and reports it.
    fn frame(&mut self, solve: impl FnOnce(&mut Self) -> Result<()>) -> Result<Deformation> {
        let start = Instant::now();
        solve(self)?;
        let mut deformation = self.report()?;
        deformation.seconds = start.elapsed().as_secs_f64();
        Ok(deformation)
    }

    /// Leads the shapes to `poses`, by way of poses between where the whole way at once fails or
    /// would take an edge too far.
    fn follow(&mut self, shapes: &[Shape], poses: &[Isometry3<f64>]) -> Result<()> {
        let from = self.state.poses.clone();
        self.cover(shapes, poses);
        let motion = self.motion(shapes, &from, poses);
        let (mut done, mut stride, mut iterations) = (0.0, 1.0, 0);
        while done < 1.0 {
            if stride * motion > EDGE_STRIDE {
                let gap = clearance(shapes, &self.state.poses, &self.zone_places()).max(0.0);
                stride = f64::min(stride, (gap + EDGE_STRIDE) / motion);
            }
            let next = f64::min(done + stride, 1.0);
            match self.attempt(shapes, between(&from, poses, next)) {
                Ok(state) => {
                    iterations += state.iterations;
                    self.state = state;
                    done = next;
                    stride *= 2.0;
                }
                Err(error) => {
                    stride *= 0.5;
                    if stride < SHORTEST_STRIDE {
                        return Err(error);
                    }
                }
            }
        }
        self.state.iterations = iterations;
        Ok(())
    }

    /// How far shapes with edges move, as seen in the middle of the zone (m).
    fn motion(&self, shapes: &[Shape], from: &[Isometry3<f64>], to: &[Isometry3<f64>]) -> f64 {
        let count = self.zone.places.len().max(1) as f64;
        let middle =
            self.zone.places.iter().map(|place| place.coords).sum::<Vector3<f64>>() / count;
        let middle = Point3::from(middle);
        let poses = shapes.iter().zip(from.iter().zip(to)).filter(|(shape, _)| has_edges(shape));
        let moved = poses
            .map(|(_, (from, to))| (to * from.inverse_transform_point(&middle) - middle).norm());
        moved.fold(0.0, f64::max)
    }

    /// Moves the shapes along `direction` until the first of them touches, at most by `farthest` (m);
    /// whether one does. A step as long as the least distance cannot pass the body.
    pub(super) fn meet(
        &mut self,
        shapes: &[Shape],
        direction: &Vector3<f64>,
        farthest: f64,
    ) -> bool {
        let surface = self.condensed.rest.surface();
        let (rest, displacement) = (self.condensed.rest.places(), &self.state.field.displacement);
        let places: Vec<_> = surface.iter().map(|point| point.place(rest, displacement)).collect();
        let mut travel = 0.0;
        while travel < farthest {
            let gap = clearance(shapes, &self.state.poses, &places);
            if gap < 0.0 {
                return true;
            }
            let stride = gap.max(self.settings.law.softness);
            travel += stride;
            for pose in &mut self.state.poses {
                pose.translation.vector += direction * stride;
            }
        }
        false
    }

    /// Where one load step to `poses` leads.
    pub(super) fn attempt(
        &mut self,
        shapes: &[Shape],
        poses: Vec<Isometry3<f64>>,
    ) -> Result<State> {
        self.cover(shapes, &poses);
        loop {
            let state = self.attempt_in_zone(shapes, &poses)?;
            let displacement = &state.field.displacement;
            let near = reached(self.condensed, shapes, &poses, displacement, 0.0);
            if !self.zone.grow(self.condensed, &near) {
                return Ok(state);
            }
        }
    }

    /// As [`Walk::attempt`], blind to what lies outside the zone.
    fn attempt_in_zone(&mut self, shapes: &[Shape], poses: &[Isometry3<f64>]) -> Result<State> {
        let start = self.zone_places();
        let anchors = self.zone.anchors_in(&self.state.anchors);
        let from = self.state.poses.clone();
        let zone = &self.zone;
        let step = ContactStep::new(shapes, &zone.surface, from, start, &anchors);
        let mut contact = Contact { zone, law: &self.settings.law, step, poses };
        let mut solution = Solution {
            rest: &self.condensed.rest,
            workspace: &mut self.workspace,
            contact: &mut contact,
            tolerance: self.settings.tolerance,
            iterations: 0,
        };
        let guess = self.state.guess(zone, poses);
        let (field, touches) =
            solution.find(&self.state.field.offset, guess, self.settings.sweeps)?;
        let iterations = solution.iterations;
        let law = &self.settings.law;
        let back = |touch: &_| stuck_at(law, zone, touch);
        let anchors = zone.anchors_out(contact.step.anchors(poses, &touches, back));
        let contact_force = zone.spread(&contact.nodal(&touches), field.displacement.len());
        let wrench = contact.wrench(&touches);
        let touches = zone.touches_out(touches);
        let poses = poses.to_vec();
        Ok(State { poses, field, contact_force, touches, anchors, wrench, iterations })
    }

    /// Makes the zone hold all that the shapes at `poses` may touch.
    fn cover(&mut self, shapes: &[Shape], poses: &[Isometry3<f64>]) {
        let displacement = &self.state.field.displacement;
        if !self.zone.covers(&reached(self.condensed, shapes, poses, displacement, 0.0)) {
            let near = reached(self.condensed, shapes, poses, displacement, MARGIN);
            self.zone = Zone::new(self.condensed, near);
        }
    }

    /// Places of the zone's surface points.
    fn zone_places(&self) -> Vec<Point3<f64>> {
        let displacement = self.zone.pick(&self.state.field.displacement);
        let points = self.zone.surface.iter();
        points.map(|point| point.place(&self.zone.places, &displacement)).collect()
    }

    /// The current state, seen from outside.
    fn report(&mut self) -> Result<Deformation> {
        let (rest, state) = (&self.condensed.rest, &self.state);
        let displacement = &state.field.displacement;
        let elastic = rest.elastic_force(displacement, &mut self.workspace);
        let mut left = elastic.ok_or(Error::Inverted)?;
        left.iter_mut().zip(&state.contact_force).for_each(|(left, force)| *left -= force);
        rest.release(&mut left);
        let residual = norm(&left);
        Ok(Deformation {
            von_mises: rest.von_mises(displacement),
            displacement: displacement.clone(),
            contact_force: state.contact_force.clone(),
            wrench: state.wrench,
            poses: state.poses.clone(),
            history: History {
                displacement: displacement.clone(),
                poses: state.poses.clone(),
                anchors: state.anchors.clone(),
            },
            iterations: state.iterations,
            residual,
            seconds: 0.0,
        })
    }
}

fn has_edges(shape: &Shape) -> bool {
    use Shape::{Capsule, Ellipsoid, HalfSpace, Sphere, StarShaped};
    !matches!(shape, Sphere { .. } | Ellipsoid { .. } | Capsule { .. } | StarShaped(_) | HalfSpace)
}

fn stuck_at(law: &ContactLaw, zone: &Zone, touch: &Touch) -> Vector3<f64> {
    law.stuck_at(&zone.surface[touch.point as usize], touch)
}
