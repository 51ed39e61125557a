//! Batch of rows that are stepped together on the threads of this process.

use std::{mem, process, sync::Arc};

use nalgebra::{Isometry3, Point3, Vector3};
use rayon::{ThreadPool, ThreadPoolBuilder, prelude::*};

use super::{
    Outcome, Row, Setup, Stage,
    answers::answers,
    contact::{PerFinger, stiffened},
    plan::{MODEL, StageTimes},
    snapshot,
};
use crate::{
    Error, Result,
    deformation::{Deformation, Press, Wanted},
    geometry::Surface,
    render::{DeformationView, DeformedBodies, SceneRenderer, Viewpoint},
    scene::MOST_DISTRACTORS,
    tactile::TactileModel,
    task::{ACTION_SIZE, EpisodeParameters, StartQuantity},
};

/// Time at which a row whose episode has ended starts the next one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Autoreset {
    /// On the next step, whose action is ignored.
    NextStep,
    /// In the same step; the last observation of the old episode is returned separately.
    SameStep,
    /// Never: the caller resets rows by mask.
    Disabled,
}

/// Most rows and most threads of a batch.
const MOST_ROWS: usize = 1_000_000;
const MOST_THREADS: usize = 1024;

/// Von Mises stress of the darkest colour in a picture, relative to Young's modulus, if the episode
/// has no stress limit: that of a small ball pressed with about 8 N.
const DARKEST: f64 = 0.3;

/// Names of the surfaces of distractors.
const DISTRACTORS: [&str; MOST_DISTRACTORS] =
    ["distractor_1", "distractor_2", "distractor_3", "distractor_4"];

/// Batch of N rows with shared settings.
pub struct Batch {
    setup: Arc<Setup>,
    rows: Vec<Row>,
    /// Time spent on all rows together.
    costs: StageTimes,
    autoreset: Autoreset,
    threads: usize,
    /// Thread pool and the id of the process that started it: a forked child has none of its
    /// threads.
    pool: Option<(u32, ThreadPool)>,
    /// Latest observations (N, D).
    observation: Vec<f32>,
    /// Renderer of all rows, created with the first picture.
    renderer: Option<SceneRenderer>,
}

/// Surface of a body of a row, in the frame of the body.
#[derive(Clone, Debug, PartialEq)]
pub struct BodySurface {
    /// "object", "distractor_1" and so on, or "fixture", whose frame is the world's.
    pub name: &'static str,
    /// Vertices (V) in m.
    pub vertices: Vec<Point3<f64>>,
    /// Corners of the triangles, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Von Mises stress at the vertices (V) in Pa, of a soft object.
    pub stress: Option<Vec<f64>>,
}

/// Result of a step of the whole batch.
#[derive(Clone, Debug, Default)]
pub struct StepResult {
    /// Observations (N, D).
    pub observation: Vec<f32>,
    /// Outcome of each row.
    pub outcomes: Vec<Outcome>,
    /// Rows whose episode ended in this step and that have already started the next one (same-step
    /// autoreset), with the last observation (D) of the ended episode.
    pub finals: Vec<(usize, Vec<f32>)>,
}

impl Batch {
    /// Creates a batch of `rows` rows that uses up to `threads` threads. No thread starts before
    /// the first step that needs one.
    pub fn new(
        setup: Arc<Setup>,
        rows: usize,
        threads: usize,
        autoreset: Autoreset,
    ) -> Result<Self> {
        for (name, found, most) in
            [("num_envs", rows, MOST_ROWS), ("num_threads", threads, MOST_THREADS)]
        {
            if !(1..=most).contains(&found) {
                return Err(Error::invalid(name, found, format!("1 to {most}")));
            }
        }
        let observation = vec![0.0; rows * setup.layout().size()];
        let rows = (0..rows as u64).map(Row::new).collect();
        Ok(Self {
            setup,
            rows,
            costs: StageTimes::default(),
            autoreset,
            threads,
            pool: None,
            observation,
            renderer: None,
        })
    }

    /// The shared settings.
    pub fn setup(&self) -> &Arc<Setup> {
        &self.setup
    }

    /// The rows.
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// Restarts the random stream of each row that has a seed.
    pub fn seed(&mut self, seeds: &[Option<u64>]) -> Result<()> {
        self.expect_length("seed", seeds.len(), "one seed a row")?;
        for (row, seed) in self.rows.iter_mut().zip(seeds) {
            if let Some(seed) = seed {
                row.seed(*seed);
            }
        }
        Ok(())
    }

    /// Starts a new episode in the rows that `mask` selects, or in all, and returns all
    /// observations (N, D). If a row cannot start one, that is an error once all others have: it is
    /// then as one that was never reset.
    pub fn reset(&mut self, mask: Option<&[bool]>) -> Result<Vec<f32>> {
        if let Some(mask) = mask {
            self.expect_length("reset_mask", mask.len(), "one flag a row")?;
            let fresh = self.rows.iter().zip(mask).position(|(row, m)| row.is_new() && !m);
            if let Some(row) = fresh {
                let found = format!("row {row} left out of its first reset");
                return Err(Error::invalid("reset_mask", found, "all rows at first"));
            }
        }
        let setup = self.setup.clone();
        let chosen = |i: usize| mask.is_none_or(|mask| mask[i]);
        let reset = self.each(|i, row, _| if chosen(i) { row.reset(&setup) } else { Ok(()) })?;
        let settled = self.solve_and_settle();
        self.each(|_, row, observation| row.open(&setup, observation))?;
        reset.into_iter().collect::<Result<()>>().and(settled)?;
        Ok(self.observation.clone())
    }

    /// Takes one step in each row; `actions` is (N, 5). If a row cannot start its next episode, that
    /// is an error once all others have taken the step: it is then as one that was never reset.
    pub fn step(&mut self, actions: &[f32]) -> Result<StepResult> {
        let (actions, rest) = actions.as_chunks::<ACTION_SIZE>();
        if !rest.is_empty() {
            return Err(Error::invalid("actions", "a part of a row", "whole rows of 5"));
        }
        self.expect_length("actions", actions.len(), "one row of 5 an environment")?;
        if let Some(i) = actions.iter().position(|a| !a.iter().all(|x| x.is_finite())) {
            let found = format!("{:?} in row {i}", actions[i]);
            return Err(Error::invalid("actions", found, "finite numbers"));
        }
        self.expect_started()?;
        let (setup, autoreset) = (self.setup.clone(), self.autoreset);
        let begun = self.each(|i, row, _| begin_step(&setup, autoreset, row, &actions[i]))?;
        let mut done = self.solve_and_settle();
        let steps = self.each(|i, row, observation| match begun[i] {
            Ok(Begun::Step) => end_step(&setup, autoreset, row, observation),
            Ok(Begun::Reset) | Err(_) => {
                row.open(&setup, observation);
                Ok((Outcome::default(), None))
            }
        })?;
        done = begun.into_iter().try_for_each(|row| row.map(drop)).and(done);
        let mut result = StepResult::default();
        for (i, step) in steps.into_iter().enumerate() {
            match step {
                Ok((outcome, last)) => {
                    result.outcomes.push(outcome);
                    result.finals.extend(last.map(|last| (i, last)));
                }
                Err(error) => done = done.and(Err(error)),
            }
        }
        if !result.finals.is_empty() {
            done = done.and(self.solve_and_settle());
            self.each(|_, row, observation| row.open(&setup, observation))?;
        }
        done?;
        Ok(StepResult { observation: self.observation.clone(), ..result })
    }

    /// Sets a quantity of the start of all further episodes of each row, `values` (N); where a
    /// value is not a number, the quantity is drawn. Returns an error if one is out of its
    /// setting's range.
    pub fn give(&mut self, quantity: StartQuantity, values: &[f64]) -> Result<()> {
        self.expect_length("start", values.len(), "one value a row")?;
        let setup = self.setup.clone();
        let mut rows = self.rows.iter_mut().zip(values);
        rows.try_for_each(|(row, &value)| row.give(quantity, value, &setup))
    }

    /// Ends the episodes of the rows in `mask` by a rule that is not the task's. With
    /// [`Autoreset::NextStep`] these rows start the next one on the next step; with the other modes
    /// the caller resets them, and with [`Autoreset::SameStep`] they would otherwise go on.
    pub fn end(&mut self, mask: &[bool]) -> Result<()> {
        self.expect_length("mask", mask.len(), "one flag a row")?;
        self.rows.iter_mut().zip(mask).filter(|(_, over)| **over).for_each(|(row, _)| row.end());
        Ok(())
    }

    /// Solves the presses of all rows, then those of the rows whose episode begins in the hand once
    /// more, after the object has come to rest with the first solutions. Returns the first error of
    /// a row, after all others are settled.
    fn solve_and_settle(&mut self) -> Result<()> {
        self.solve_presses();
        let mut done = Ok(());
        while self.rows.iter().any(Row::is_unsettled) {
            let setup = self.setup.clone();
            let settled = self.each(|_, row, _| row.settle(&setup))?;
            done = done.and(settled.into_iter().collect());
            self.solve_presses();
        }
        done
    }

    /// Solves the presses of all rows in one call.
    fn solve_presses(&mut self) {
        if matches!(self.setup.tactile(), TactileModel::Rigid) {
            return;
        }
        let (mut from, mut presses) = (Vec::new(), Vec::new());
        for (i, row) in self.rows.iter_mut().enumerate() {
            for (finger, press) in row.ask().into_iter().enumerate() {
                from.extend(press.as_ref().map(|_| (i, finger)));
                presses.extend(press);
            }
        }
        if presses.is_empty() {
            return;
        }
        let wanted = self.setup.wanted();
        let pool = self.pool.as_ref().map(|(_, pool)| pool);
        let objects: Vec<_> = from.iter().map(|&(i, _)| self.rows[i].object()).collect();
        let solve = || answers(self.setup.tactile(), &objects, &presses, wanted, pool);
        let answers = self.costs.time_all(MODEL, presses.len() as u64, solve);
        for ((i, finger), answer) in from.into_iter().zip(answers) {
            self.rows[i].answer(finger, answer);
        }
    }

    /// Stages of a step of this batch, with their mean times since the start, the last
    /// [`Batch::load`] or the last call with `forget`.
    pub fn plan(&mut self, forget: bool) -> Vec<Stage> {
        let mut costs = self.costs.clone();
        self.rows.iter().for_each(|row| costs.include(row.costs()));
        if forget {
            self.forget_costs();
        }
        costs.plan(&self.setup)
    }

    fn forget_costs(&mut self) {
        self.costs = StageTimes::default();
        self.rows.iter_mut().for_each(Row::forget_costs);
    }

    /// Draws the scene of one row as an sRGB picture (height, width, 3).
    pub fn render(
        &mut self,
        row: usize,
        [width, height]: [usize; 2],
        viewpoint: &Viewpoint,
    ) -> Result<Vec<u8>> {
        let state = self.rows.get(row).and_then(Row::state);
        let Some((state, draw)) = state else {
            return Err(Error::invalid("render", format!("row {row}"), "a row that was reset"));
        };
        let (setup, deformation) = (self.setup.clone(), self.current_deformation(row, &draw)?);
        let view = setup.tactile().shell(draw.object).map(|shell| {
            let deformation = deformation.each_ref().map(Option::as_ref);
            let (bodies, darkest) = match setup.tactile() {
                TactileModel::Objects(_) => {
                    let material = setup.config().task.soft_material();
                    let crush = material.map_or(1.0, |material| material.crush);
                    let darkest = crush * draw.young.unwrap_or(1.0);
                    (DeformedBodies::Object(deformation[0]), darkest)
                }
                model => {
                    let young = model.pads().map_or(1.0, |pad| pad.skin().young());
                    let darkest = draw.stress_limit.unwrap_or(DARKEST * young);
                    (DeformedBodies::Pads(deformation), darkest)
                }
            };
            DeformationView { shell, bodies, darkest }
        });
        let sized = |(object, scale): (usize, f64)| setup.models()[object].shape().scaled(scale);
        let shapes: Vec<_> = draw.bodies().map(sized).collect();
        let mut renderer = match self.renderer.take() {
            Some(renderer) if renderer.size() == (width, height) => renderer,
            _ => SceneRenderer::new(width, height)?,
        };
        let fixture = setup.config().task.fixture(&shapes[0], &draw)?;
        let picture = renderer.draw(viewpoint, &state, &shapes, fixture.as_ref(), view.as_ref());
        self.renderer = Some(renderer);
        picture
    }

    /// Surfaces of the object of one row, deformed if it is soft, of the distractors, and of the
    /// fixture if the task has one. Empty before the first reset.
    pub fn surfaces(&mut self, row: usize) -> Result<Vec<BodySurface>> {
        let Some((_, draw)) = self.rows.get(row).and_then(Row::state) else {
            return Ok(Vec::new());
        };
        let setup = self.setup.clone();
        let model = &setup.models()[draw.object];
        let object = if let Some(soft) = setup.tactile().object(draw.object) {
            let deformation = self.current_deformation(row, &draw)?[0].take();
            BodySurface {
                name: "object",
                vertices: soft.shell().places(deformation.as_ref()),
                triangles: soft.shell().triangles().to_vec(),
                stress: Some(soft.shell().stress(deformation.as_ref())),
            }
        } else {
            BodySurface::rigid("object", &model.surface().scaled(draw.scale))
        };
        let fixture = setup.config().task.fixture(&model.shape().scaled(draw.scale), &draw)?;
        let fixture = fixture.map(|fixture| BodySurface::of_boxes("fixture", &fixture.boxes()));
        let distractors = draw.distractors.iter().flatten().zip(DISTRACTORS);
        let distractors = distractors.map(|(body, name)| {
            BodySurface::rigid(name, &setup.models()[body.object].surface().scaled(body.scale))
        });
        Ok([object].into_iter().chain(distractors).chain(fixture).collect())
    }

    /// Solves the current contact of a row with these `parameters` again, for a picture; `None`
    /// where nothing touches or the solution fails. The state of the row does not change.
    fn current_deformation(
        &mut self,
        row: usize,
        parameters: &EpisodeParameters,
    ) -> Result<PerFinger<Deformation>> {
        self.start_threads()?;
        let pool = self.pool.as_ref().map(|(_, pool)| pool);
        let wanted = Wanted { stress: true, residual: false };
        let deformation = self.rows[row].touch_again(&self.setup)?.map(|press| {
            let press = press.as_slice();
            answers(self.setup.tactile(), &[parameters.object], press, wanted, pool).pop()
        });
        let deformation = stiffened(
            deformation.map(|answer| answer.map(|answer| answer.found)),
            self.setup.stiffness(parameters),
        );
        Ok(deformation.map(|answer| answer?.ok()))
    }

    /// Presses of the pads of a row as its bodies stand, from rest; `None` where nothing can touch,
    /// before the first reset, and of fingers that do not deform.
    pub fn presses(&self, row: usize) -> Result<[Option<Press>; 2]> {
        let row = self.rows.get(row).filter(|_| self.setup.tactile().pads().is_some());
        let found = row.map_or(Ok([None, None]), |row| row.touch_again(&self.setup))?;
        let [a, b] = found.map(|press| press.as_ref().and_then(Press::at_end));
        Ok([a.transpose()?, b.transpose()?])
    }

    /// Saves each row as bytes, without the quantities given by [`Batch::give`].
    pub fn save(&self) -> Vec<Vec<u8>> {
        let size = self.setup.layout().size();
        let rows = self.rows.iter().zip(self.observation.chunks(size));
        rows.map(|(row, observation)| snapshot::save(row, observation, &self.setup)).collect()
    }

    /// Restores each row from the result of [`Batch::save`] and returns all observations (N, D).
    /// The start of further episodes is drawn. On an error nothing changes.
    pub fn load(&mut self, states: &[impl AsRef<[u8]>]) -> Result<Vec<f32>> {
        self.expect_length("state", states.len(), "one snapshot a row")?;
        let (mut rows, mut observation) = (Vec::new(), Vec::new());
        for state in states {
            let (row, latest) = snapshot::load(state.as_ref(), &self.setup)?;
            rows.push(row);
            observation.extend(latest);
        }
        (self.rows, self.observation) = (rows, observation);
        self.forget_costs();
        Ok(self.observation.clone())
    }

    fn expect_length(&self, name: &str, found: usize, expected: &str) -> Result<()> {
        let rows = self.rows.len();
        if found == rows {
            return Ok(());
        }
        Err(Error::invalid(name, format!("{found} of them"), format!("{expected}: {rows}")))
    }

    fn expect_started(&self) -> Result<()> {
        let started = |row: &Row| match self.autoreset {
            Autoreset::Disabled => !row.needs_reset(),
            _ => !row.is_new(),
        };
        let Some(row) = self.rows.iter().position(|row| !started(row)) else { return Ok(()) };
        let found = format!("row {row} without a running episode");
        let error = Error::invalid("step", found, "a reset before it");
        let reset = "reset_mask in the options of reset says which rows begin anew";
        Err(if self.autoreset == Autoreset::Disabled { error.hinting(reset) } else { error })
    }

    /// Calls `act` with the index, the row and the observation (D) of each row, and returns the
    /// results.
    fn each<T: Send>(
        &mut self,
        act: impl Fn(usize, &mut Row, &mut [f32]) -> T + Sync,
    ) -> Result<Vec<T>> {
        let size = self.setup.layout().size();
        self.start_threads()?;
        // With a single thread, the transfer to it would only cost time.
        let pool = self.pool.as_ref().filter(|_| self.wanted_threads() > 1);
        let (rows, observation) = (&mut self.rows, &mut self.observation);
        let Some((_, pool)) = pool else {
            let rows = rows.iter_mut().zip(observation.chunks_mut(size)).enumerate();
            return Ok(rows.map(|(i, (row, observation))| act(i, row, observation)).collect());
        };
        let rows = rows.par_iter_mut().zip(observation.par_chunks_mut(size)).enumerate();
        Ok(pool.install(|| rows.map(|(i, (row, o))| act(i, row, o)).collect()))
    }

    fn wanted_threads(&self) -> usize {
        self.threads.min(self.rows.len())
    }

    /// Starts the thread pool if it is needed and this process has none.
    fn start_threads(&mut self) -> Result<()> {
        let (wanted, process) = (self.wanted_threads(), process::id());
        // Models run in parallel on the pool from which they are called, by default the global one.
        let needed = wanted > 1 || !matches!(self.setup.tactile(), TactileModel::Rigid);
        if !needed || self.pool.as_ref().is_some_and(|(owner, _)| *owner == process) {
            return Ok(());
        }
        // The pool of a parent process cannot be dropped here: its threads do not exist in this
        // process and cannot be joined.
        mem::forget(self.pool.take());
        let pool = ThreadPoolBuilder::new().num_threads(wanted).build();
        let pool =
            pool.map_err(|error| Error::invalid("num_threads", error, "threads to start"))?;
        self.pool = Some((process, pool));
        Ok(())
    }
}

/// Action of a row in the first phase of a step.
#[derive(Clone, Copy)]
enum Begun {
    /// Starts a new episode.
    Reset,
    /// Moves its rigid bodies.
    Step,
}

/// Runs the first phase of a step for one row.
fn begin_step(
    setup: &Setup,
    autoreset: Autoreset,
    row: &mut Row,
    action: &[f32; ACTION_SIZE],
) -> Result<Begun> {
    if autoreset == Autoreset::NextStep && row.needs_reset() {
        row.reset(setup)?;
        return Ok(Begun::Reset);
    }
    row.advance(setup, action);
    Ok(Begun::Step)
}

/// Runs the last phase of a step for one row. Returns the outcome, and the last observation (D) of
/// the ended episode if the row has started a new one.
fn end_step(
    setup: &Setup,
    autoreset: Autoreset,
    row: &mut Row,
    observation: &mut [f32],
) -> Result<(Outcome, Option<Vec<f32>>)> {
    let mut scratch = vec![0.0; observation.len()];
    let outcome = row.conclude(setup, observation, &mut scratch);
    if autoreset != Autoreset::SameStep || !row.needs_reset() {
        return Ok((outcome, None));
    }
    row.reset(setup)?;
    Ok((outcome, Some(observation.to_vec())))
}

impl BodySurface {
    fn rigid(name: &'static str, surface: &Surface) -> Self {
        let (vertices, triangles) = (surface.vertices().to_vec(), surface.triangles().to_vec());
        Self { name, vertices, triangles, stress: None }
    }

    /// Surface of boxes, by the poses of their middles and half of their extents (m).
    fn of_boxes(name: &'static str, boxes: &[(Isometry3<f64>, Vector3<f64>)]) -> Self {
        let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
        for (pose, half_extents) in boxes {
            let surface = Surface::cuboid(half_extents);
            let first = vertices.len() as u32;
            vertices.extend(surface.vertices().iter().map(|vertex| pose * vertex));
            triangles.extend(surface.triangles().iter().map(|t| t.map(|corner| first + corner)));
        }
        Self { name, vertices, triangles, stress: None }
    }
}
