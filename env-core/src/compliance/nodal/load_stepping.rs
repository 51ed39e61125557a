//! Load stepping of a press with contact at the nodes.

use std::{cell::LazyCell, collections::BTreeMap, time::Instant};

use nalgebra::{Isometry3, Vector3};

use super::{
    super::push::{ForceControlled, push},
    between::{ContactTriangle, Standing, watched},
    check_friction,
    contact_nodes::ContactNodes,
    grid::CellGrid,
    patch::{Move, NodalScratch, Patch, give},
    resolution::ContactResolution,
    state::{ContactSolution, Held, NodalState, forces, outside, recalled},
};
use crate::{
    Error, Result,
    contact::{ContactLaw, PointGroup, between, clearance, gap},
    deformation::{
        Anchor, FrameDrive, History, NextStep, Press, Wrench, solve_frames, solve_in_steps,
    },
    error::StepDefect,
    fem::FemOptions,
    geometry::Shape,
};

/// Greatest motion of a shape in one load step (m), or half its thickness if that is less.
const LONGEST_STEP: f64 = 5e-4;
/// Allowance added to the motion of the shapes when the nodes near them are selected (m).
const MARGIN: f64 = 1e-4;
/// Most cells of a level that are searched for a first touch.
const WIDE: usize = 24_000;
/// Least breadth and thickness, in sides of a cell, of a wall that cells resolve. A strip in any
/// direction that is thicker than a side and at least 2.7 sides long covers the centre of a cell in
/// every row that it crosses. The thickness has a margin of a fifth for walls that lean.
const WALL: [f64; 2] = [4.0, 1.2];
/// More touching cells than the edge of a thin wall can have: a strip three cells wide, across a
/// pad and back. Where more touch, the wall lies on its side.
const BROAD: usize = 256;
/// Smallest part of the longest step that is tried.
const SHORTEST: f64 = 1.0 / 64.0;

/// A press during load stepping.
pub(super) struct NodalLoadStepping<'a> {
    /// Contact nodes of the body; if there are several sets, each is a grid of cells half as long
    /// as those before.
    levels: &'a [ContactNodes],
    law: ContactLaw,
    shapes: &'a [Shape],
    /// Faces that a shape could penetrate without touching a node.
    watched: &'a [ContactTriangle],
    resolution: ContactResolution,
    /// Greatest motion of a shape in one load step (m).
    longest_step: f64,
    scratch: &'a mut NodalScratch,
    /// Sweeps times the square of the number of nodes that touch, in this frame.
    work: usize,
    pub(super) state: NodalState,
}

/// Numbers of cells that may touch on each level.
struct LevelChoice {
    /// Coarsest level whose cells feel every shape if thin walls touch by their side.
    broadest: usize,
    /// Coarsest level whose cells feel every shape.
    lowest: usize,
    finest: usize,
    resolution: ContactResolution,
}

impl LevelChoice {
    /// Most cells that may touch on a level; `None` if there is none that is coarser. On those on
    /// which a thin wall must touch by its side, they are as many as show that it does.
    fn most(&self, level: usize) -> Option<usize> {
        match level {
            _ if level > self.lowest => Some(self.resolution.most),
            _ if level > self.broadest => Some(self.broad()),
            _ => None,
        }
    }

    /// Fewest cells that touch on a level unless a finer one is tried.
    fn fewest(&self, level: usize) -> usize {
        match level {
            _ if level == self.finest => 0,
            _ if level < self.lowest => self.broad() / 8,
            _ => self.resolution.few,
        }
    }

    /// Cells that touch where a thin wall touches by its side.
    fn broad(&self) -> usize {
        BROAD.max(self.resolution.most)
    }
}

impl<'a> NodalLoadStepping<'a> {
    /// Begins load stepping where `press` begins, with its friction or that of `law`.
    pub(super) fn new(
        (levels, resolution): (&'a [ContactNodes], ContactResolution),
        law: ContactLaw,
        press: &'a Press,
        scratch: &'a mut NodalScratch,
    ) -> Result<Self> {
        let friction = press.friction().unwrap_or(law.friction);
        check_friction(friction)?;
        let law = ContactLaw { friction, ..law };
        let shapes = press.shapes();
        let nodes = &levels[0];
        let state = match press.history() {
            Some(history) => recalled(levels, history)?,
            None => NodalState {
                level: levels.len() - 1,
                poses: outside(levels, shapes, press.drive().first())?,
                held: Vec::new(),
                wrench: Wrench::default(),
                amplitude: 0.0,
                sweeps: 0,
            },
        };
        let watched = watched(&nodes.faces, shapes);
        let thickness = shapes.iter().map(Shape::thickness).fold(f64::INFINITY, f64::min);
        let longest_step = f64::min(LONGEST_STEP, 0.5 * thickness);
        Ok(Self { levels, law, shapes, watched, resolution, longest_step, scratch, work: 0, state })
    }

    /// Solves every frame of `press`; the first that fails is the last.
    pub(super) fn every(mut self, press: &Press) -> Vec<Result<ContactSolution>> {
        solve_frames(press.frames(), |frame| {
            let start = Instant::now();
            match frame {
                FrameDrive::Poses(poses) => self.follow(poses)?,
                FrameDrive::Force { force, direction } => push(&mut self, force, direction)?,
            }
            // A thick shape touches a node before it is through, but not before it is deep.
            let all_if_unfelt = |felt| if felt { &[][..] } else { &self.levels[0].faces };
            self.check_between(&self.state, all_if_unfelt)?;
            Ok(self.settled(start.elapsed().as_secs_f64()))
        })
    }

    /// Moves the shapes to `poses` in load steps.
    fn follow(&mut self, poses: &[Isometry3<f64>]) -> Result<()> {
        let from = self.state.poses.clone();
        let motion = from.iter().zip(poses).map(|(a, b)| self.motion(a, b)).fold(0.0, f64::max);
        // The size of a step is relative to the longest one.
        let length = |stepping: &Self, step: &mut NextStep| {
            step.size = f64::min(step.size, 1.0);
            let longest = stepping.gap(motion * (1.0 - step.done)) + stepping.longest_step;
            step.size * (longest / motion.max(f64::MIN_POSITIVE))
        };
        let retry = |stepping: &Self, _: &Error, step: NextStep| {
            step.size >= SHORTEST && stepping.work <= stepping.resolution.work
        };
        let mut sweeps = 0;
        self.work = 0;
        solve_in_steps(self, length, retry, |stepping, t| {
            if stepping.work > stepping.resolution.work {
                return Err(Error::StepTooLong { defect: StepDefect::OverWorkLimit });
            }
            stepping.state = stepping.attempt(&between(&from, poses, t))?;
            sweeps += stepping.state.sweeps;
            Ok(())
        })?;
        self.state.sweeps = sweeps;
        Ok(())
    }

    /// Greatest motion of a shape between two poses, measured at the groups of nodes (m).
    fn motion(&self, from: &Isometry3<f64>, to: &Isometry3<f64>) -> f64 {
        let moved = |group: &PointGroup| {
            (to * from.inverse_transform_point(&group.centre) - group.centre).norm()
        };
        self.levels[0].groups.iter().map(moved).fold(0.0, f64::max)
    }

    /// Distance, at most `enough` (m), by which the shapes can move without touching a node or a
    /// checked face; 0 if they touch.
    fn gap(&self, enough: f64) -> f64 {
        let mut gap = enough;
        let between = self.watched.first().map_or(0.0, ContactTriangle::reach);
        for group in &self.levels[0].groups {
            for (shape, pose) in self.shapes.iter().zip(&self.state.poses) {
                if gap <= 0.0 {
                    return 0.0;
                }
                let distance = shape.distance(&pose.inverse_transform_point(&group.centre)).value;
                gap = gap.min(distance - group.radius - self.state.amplitude - between);
            }
        }
        gap.max(0.0)
    }

    /// Attempts one load step to `poses` and returns the state it ends in.
    ///
    /// On a body with several levels of cells, the step is taken on the finest level on which no
    /// more cells touch than [`LevelChoice`] allows, or stays on that of the last step if it is
    /// coarser and few cells touch there.
    pub(super) fn attempt(&mut self, poses: &[Isometry3<f64>]) -> Result<NodalState> {
        let motion = self.state.poses.iter().zip(poses).map(|(a, b)| self.motion(a, b));
        let reach = motion.fold(0.0, f64::max) + MARGIN;
        let choice = self.choice();
        let (mut level, mut held) = (self.state.level, self.state.held.clone());
        if held.is_empty() {
            let Some(first) = self.first_touch(choice.lowest, poses) else {
                let state = self.untouched(poses);
                return self.check_inside(&state).map(|()| state);
            };
            level = first;
        }
        while level < choice.broadest {
            held = self.finer(level, &held);
            level += 1;
        }
        let mut was_finer = false;
        loop {
            let is_coarse = match self.attempt_on(level, &held, poses, reach, choice.most(level)) {
                Ok(Some(state)) if was_finer || state.held.len() >= choice.fewest(level) => {
                    return Ok(state);
                }
                Ok(Some(_)) => true,
                Ok(None) => false,
                Err(Error::NotConverged { residual, .. })
                    if level > choice.lowest && residual.is_finite() =>
                {
                    false
                }
                Err(error) => return Err(error),
            };
            if is_coarse {
                held = self.finer(level, &held);
                level += 1;
            } else {
                was_finer = true;
                held = self.coarser(level, &held);
                level -= 1;
            }
        }
    }

    /// Rule by which the level of a step is chosen.
    fn choice(&self) -> LevelChoice {
        let [broadest, lowest] = [true, false].map(|as_walls| self.coarsest(as_walls));
        LevelChoice { broadest, lowest, finest: self.levels.len() - 1, resolution: self.resolution }
    }

    /// Finest level from `lowest` on of which some, but not many cells at rest are inside shapes at
    /// `poses`; `None` if none of any level are. Levels of which more than [`WIDE`] cells may be
    /// inside are skipped: the shape is wider than their cells.
    fn first_touch(&self, lowest: usize, poses: &[Isometry3<f64>]) -> Option<usize> {
        let mut open: Vec<u32> = (0..self.levels[lowest].len() as u32).collect();
        let mut found = None;
        for level in lowest..self.levels.len() {
            let Some(grid) = self.levels[level].grid() else { return Some(level) };
            let gap = |rank: &u32| gap(self.shapes, poses, &grid.place(*rank));
            let gaps: Vec<_> = open.iter().map(gap).collect();
            match gaps.iter().filter(|gap| **gap < 0.0).count() {
                0 => {}
                inside if inside > 2 * self.resolution.most => return Some(found.unwrap_or(level)),
                _ => found = Some(level),
            }
            let near = open.iter().zip(&gaps).filter(|(_, gap)| **gap < grid.half_diagonal());
            open = near.flat_map(|(rank, _)| grid.children(*rank)).collect();
            if open.len() > WIDE {
                break;
            }
        }
        found
    }

    /// State with the shapes at `poses` if none touches.
    fn untouched(&self, poses: &[Isometry3<f64>]) -> NodalState {
        NodalState {
            poses: poses.to_vec(),
            level: self.levels.len() - 1,
            held: Vec::new(),
            wrench: Wrench::default(),
            amplitude: 0.0,
            sweeps: 0,
        }
    }

    /// Coarsest level whose cells no shape can pass between: no ball as thick as the shapes, or no
    /// strip of a wall if they are taken `as_walls`.
    fn coarsest(&self, as_walls: bool) -> usize {
        let is_felt = |grid: &CellGrid, shape: &Shape| {
            let (thickness, side) = (shape.thickness(), grid.longest_side());
            2.0 * grid.half_diagonal() < thickness
                || (as_walls && shape.breadth() > WALL[0] * side && thickness > WALL[1] * side)
        };
        let is_fine = |nodes: &ContactNodes| {
            let all_are_felt = |grid| self.shapes.iter().all(|shape| is_felt(grid, shape));
            nodes.grid().is_none_or(all_are_felt)
        };
        self.levels.iter().position(is_fine).unwrap_or(self.levels.len() - 1)
    }

    /// The cells that are `held` on a level as those of the next finer one.
    fn finer(&mut self, level: usize, held: &[Held]) -> Vec<Held> {
        let Some(grid) = self.levels[level].grid() else { return Vec::new() };
        let quarters = |held: &Held| {
            let (shape, force) = (held.shape, held.force * 0.25);
            grid.children(held.rank).map(|rank| (rank, (shape, force)))
        };
        let forces = held.iter().flat_map(quarters).collect();
        self.stuck(level + 1, forces)
    }

    /// The cells that are `held` on a level as those of the next coarser one.
    fn coarser(&mut self, level: usize, held: &[Held]) -> Vec<Held> {
        let Some(grid) = self.levels[level].grid() else { return Vec::new() };
        let mut forces = BTreeMap::new();
        for Held { rank, shape, force, .. } in held {
            // The first shape stands for all.
            let sum = forces.entry(grid.parent(*rank)).or_insert((*shape, Vector3::zeros()));
            if sum.0 == *shape {
                sum.1 += force;
            }
        }
        self.stuck(level - 1, forces)
    }

    /// Cells of a level, by rank with a shape and its force on them (N), stuck to where these forces
    /// hold them with the shapes at their present poses. Where cells of another size stuck would
    /// not do: the same forces move these otherwise, and friction would build up or be lost.
    fn stuck(&mut self, level: usize, forces: BTreeMap<u32, (u32, Vector3<f64>)>) -> Vec<Held> {
        let nodes = &self.levels[level];
        let Some(grid) = nodes.grid() else { return Vec::new() };
        let NodalScratch { displacement, spots } = &mut *self.scratch;
        spots.renew(grid, forces.keys().copied(), displacement);
        for (spot, (_, force)) in forces.values().enumerate() {
            spots.add_response(grid, spot, force, displacement);
            spots.update_passive(grid, spot, force, displacement);
        }
        let one = |(spot, (rank, (shape, force))): (usize, (u32, (u32, Vector3<f64>)))| {
            let (form, pose) = (&self.shapes[shape as usize], &self.state.poses[shape as usize]);
            let place = nodes.place(rank) + spots.moved(spot, displacement);
            let normal =
                pose.rotation * form.distance(&pose.inverse_transform_point(&place)).normal;
            let place = place + give(&self.law, nodes.point(rank), &normal) * force;
            Held { rank, shape, stuck: pose.inverse_transform_point(&place), force, normal }
        };
        forces.into_iter().enumerate().map(one).collect()
    }

    /// Performs [`NodalLoadStepping::attempt`] on one level from the nodes `held` there; `None` if
    /// more than `most` of its nodes touch.
    fn attempt_on(
        &mut self,
        level: usize,
        held: &[Held],
        poses: &[Isometry3<f64>],
        reach: f64,
        most: Option<usize>,
    ) -> Result<Option<NodalState>> {
        let mut room = self.state.amplitude + reach;
        loop {
            let state = self.attempt_within((level, held), poses, [room, reach], most)?;
            let Some(state) = state else { return Ok(None) };
            if state.amplitude <= room {
                if most.is_some_and(|most| state.held.len() > most) {
                    return Ok(None);
                }
                self.check_between(&state, |_| self.watched)?;
                self.check_inside(&state)?;
                return Ok(Some(state));
            }
            room = 2.0 * state.amplitude;
        }
    }

    /// Performs [`NodalLoadStepping::attempt_on`] on the assumption that no node is displaced by
    /// more than `room` (m) in total and by more than `reach` (m) in this step.
    fn attempt_within(
        &mut self,
        (level, held): (usize, &[Held]),
        poses: &[Isometry3<f64>],
        [room, reach]: [f64; 2],
        most: Option<usize>,
    ) -> Result<Option<NodalState>> {
        let (shapes, nodes) = (self.shapes, &self.levels[level]);
        let from = &self.state.poses;
        let motion = Move { shapes, from, to: poses };
        let most = most.map_or(usize::MAX, |most| 2 * most);
        let patch = Patch::new(nodes, &self.law, motion, [room, reach], most, held, self.scratch);
        let Some(mut patch) = patch else { return Ok(None) };
        let settled = patch.settle();
        let sweeps = match &settled {
            Err(Error::NotConverged { iterations, .. }) => *iterations,
            settled => *settled.as_ref().unwrap_or(&0),
        };
        self.work += sweeps * patch.touching().pow(2);
        settled?;
        if patch.leaps() {
            return Err(Error::StepTooLong { defect: StepDefect::PassedSurface });
        }
        if patch.folds() {
            return Err(Error::Inverted);
        }
        if let Some([depth, most]) = patch.pierced() {
            return Err(Error::Penetrated { depth, most });
        }
        let held = patch.held();
        let wrench = Wrench::of_forces(held.iter().map(|(held, place)| (held.force, place.coords)));
        if !wrench.force.iter().chain(wrench.torque.iter()).all(|x| x.is_finite()) {
            return Err(Error::StepTooLong { defect: StepDefect::NotFinite });
        }
        let amplitude = patch.amplitude();
        let held = held.into_iter().map(|(held, _)| held).collect();
        Ok(Some(NodalState { poses: poses.to_vec(), level, held, wrench, amplitude, sweeps }))
    }

    /// Returns an error if a shape is inside the held faces or has passed over them, or is inside
    /// the body without touching a node.
    fn check_inside(&self, state: &NodalState) -> Result<()> {
        let condensed = &self.levels[0].condensed;
        let most = self.law.deep();
        condensed.backing.check(self.shapes, [&self.state.poses, &state.poses], most)?;
        for (s, (shape, pose)) in self.shapes.iter().zip(&state.poses).enumerate() {
            if state.held.iter().any(|held| held.shape as usize == s) {
                continue;
            }
            if self.levels[0].engulfs(shape, pose) {
                return Err(Error::StepTooLong { defect: StepDefect::Engulfed });
            }
        }
        Ok(())
    }

    /// Returns an error if a shape penetrates too deeply between nodes, in one of the `faces` of a
    /// shape that is felt, or is not.
    fn check_between<'b>(
        &self,
        state: &NodalState,
        faces: impl Fn(bool) -> &'b [ContactTriangle],
    ) -> Result<()> {
        let displacement =
            LazyCell::new(|| self.levels[state.level].displacement(&forces(&state.held)));
        let displaced = |rank: u32| displacement[rank as usize];
        for (s, (shape, pose)) in (0..).zip(self.shapes.iter().zip(&state.poses)) {
            let felt = state.held.iter().any(|held| held.shape == s);
            for face in faces(felt) {
                let standing = Standing { shape, pose, felt };
                let found = face.penetrated(standing, state.amplitude, displaced);
                if let Some([depth, most]) = found {
                    return Err(Error::Penetrated { depth, most });
                }
            }
        }
        Ok(())
    }

    /// Current state as a [`ContactSolution`].
    fn settled(&self, seconds: f64) -> ContactSolution {
        let NodalState { poses, level, held, wrench, sweeps, .. } = &self.state;
        let first = self.levels[..*level].iter().map(|nodes| nodes.len() as u32).sum::<u32>();
        let anchor =
            |held: &Held| Anchor { shape: held.shape, point: first + held.rank, place: held.stuck };
        ContactSolution {
            level: *level,
            forces: forces(held),
            normals: held.iter().map(|held| held.normal).collect(),
            wrench: *wrench,
            sliding: self.law.sliding_share(held.iter().map(|held| (held.force, held.normal))),
            history: History {
                model: self.levels[0].identity(),
                displacement: Vec::new(),
                poses: poses.clone(),
                anchors: held.iter().map(anchor).collect(),
                forces: held.iter().map(|held| held.force).collect(),
                folded: false,
            },
            iterations: *sweeps,
            seconds,
        }
    }
}

impl ForceControlled for NodalLoadStepping<'_> {
    type State = NodalState;

    fn poses(&mut self) -> &mut [Isometry3<f64>] {
        &mut self.state.poses
    }

    fn clearance(&self, poses: &[Isometry3<f64>]) -> f64 {
        if !self.state.held.is_empty() {
            return -f64::MIN_POSITIVE;
        }
        match self.levels[self.levels.len() - 1].grid() {
            Some(finest) => finest.clearance(self.shapes, poses),
            None => clearance(self.shapes, poses, &self.levels[0].places),
        }
    }

    fn attempt(&mut self, poses: &[Isometry3<f64>]) -> Result<NodalState> {
        self.attempt(poses)
    }

    fn state(&mut self) -> &mut NodalState {
        &mut self.state
    }

    fn tolerance(&self) -> f64 {
        FemOptions::default().tolerance
    }

    fn wrench(state: &NodalState) -> &Wrench {
        &state.wrench
    }

    fn iterations(state: &mut NodalState) -> &mut usize {
        &mut state.sweeps
    }
}
