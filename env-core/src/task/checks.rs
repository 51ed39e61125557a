//! Checks of a task's settings, and of its objects between the pads.

use super::{
    ObjectSpec, ObservationLayout, Start, TaskConfig,
    config::AS_CALIBRATED,
    sensor_errors,
    setting::{rising, within},
};
use crate::{
    Error, Result,
    scene::{ObjectModel, SceneObject},
};

/// Length of the shortest object that is taken (m): a smaller one is a wrong unit.
const SHORTEST: f64 = 2e-3;

impl TaskConfig {
    /// Returns an error that names the first setting out of its range.
    pub fn validate(&self) -> Result<()> {
        self.scene.validate().map_err(|error| {
            let of_gel = matches!(&error, Error::Invalid { name, .. } if name == "pads.young");
            if of_gel { error.renamed("material.young") } else { error }
        })?;
        for setting in self.clone().settings() {
            setting.validate()?;
        }
        let workspace = &self.scene.workspace;
        let flat = [0, 1].map(|axis| (workspace.low[axis], workspace.high[axis]));
        let flat = [flat[0].0.max(flat[1].0), flat[0].1.min(flat[1].1)];
        let upright = [workspace.low[2], workspace.high[2]];
        rising("position", self.position, flat)?;
        rising("start", self.start, flat)?;
        rising("start_height", self.start_height, upright)?;
        within("lift_height", self.lift_height, [0.001, upright[1]])?;
        if !(1..=1_000_000).contains(&self.max_episode_steps) {
            let steps = self.max_episode_steps;
            return Err(Error::invalid("max_episode_steps", steps, "1 to 1000000 steps"));
        }
        if !(1..=1000).contains(&self.objects.len()) {
            return Err(Error::invalid("objects", self.objects.len(), "1 to 1000 objects"));
        }
        self.touch().validate()?;
        let most = self.tactile.most_friction();
        if self.pads_feel() && self.friction[1] > most {
            let expected = format!("up to {most} with tactile \"surrogate\" and \"compliance\"");
            return Err(Error::invalid("friction", format!("{:?}", self.friction), expected));
        }
        if self.gel_stiffness != AS_CALIBRATED && !self.pads_feel() {
            let found = format!("{:?}", self.gel_stiffness);
            return Err(Error::invalid("gel_stiffness", found, "1 where no pad is soft"));
        }
        if let Some(grip) = self.task.gradual_grip() {
            grip.validate(self.scene.gripper.max_force)?;
        }
        self.task.validate(self)?;
        ObservationLayout::check(self)?;
        sensor_errors::validate(&self.sensor_errors, &self.channels())?;
        self.reward.validate()
    }

    /// Models of the objects, checked at both ends of the ranges of mass and size.
    pub fn models(&self) -> Result<Vec<ObjectModel>> {
        let models: Vec<_> = self.objects.iter().map(ObjectSpec::model).collect::<Result<_>>()?;
        for (spec, model) in self.objects.iter().zip(&models) {
            self.fits(spec, model)?;
            for (mass, scale) in self.mass.into_iter().zip(self.size) {
                let pose = model.rest(scale, 0.0, 0.0, 0.0);
                let object = SceneObject { model, scale, mass, friction: self.friction[0], pose };
                object.validate(&self.scene.gripper)?;
            }
        }
        Ok(models)
    }

    /// Returns an error unless the object is long enough to be grasped and fits between the open
    /// pads: across its narrowest side if the hand starts over it, otherwise across a horizontal
    /// side.
    fn fits(&self, spec: &ObjectSpec, model: &ObjectModel) -> Result<()> {
        let (low, high) = model.surface().bounds();
        let longest = (high - low).max() * self.size[0];
        if longest < SHORTEST {
            let found = format!("{spec}, {:.3} mm along its longest side", 1e3 * longest);
            let expected = format!(
                "{:.0} mm or more; lengths are in m, and scale is the length of a mesh file's unit",
                1e3 * SHORTEST
            );
            return Err(Error::invalid("objects", found, expected));
        }
        let narrow = match self.task.start() {
            Start::AroundObject | Start::InHand => model.width_in_hand(self.size[1]),
            Start::OverTable => (high - low).min() * self.size[1],
        };
        let opening = self.scene.gripper.max_opening;
        if narrow < opening {
            return Ok(());
        }
        let found = format!("{spec}, {narrow:.3} m across its narrowest side");
        let most = self.size[1] * opening / narrow;
        let expected = format!(
            "less than the opening of {opening} m; the setting size scales it, here below {most:.2}"
        );
        Err(Error::invalid("objects", found, expected))
    }
}
