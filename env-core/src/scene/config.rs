//! Settings of a scene in SI, with the reason for every default.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::Fixture;
use crate::{
    Error, Result,
    deformation::Moduli,
    error::within,
    geometry::PadOutline,
    objects::OPENING,
    sensor::{Calibration, ElasticFoundation, Sensor},
};

/// Greatest number of free bodies beside the object.
pub const MOST_DISTRACTORS: usize = 4;

/// Settings of a scene, except its bodies.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SceneConfig {
    /// The hand.
    pub gripper: Gripper,
    /// Allowed positions of the tool centre.
    pub workspace: Workspace,
    /// Time step and solver settings of Rapier.
    pub physics: Physics,
    /// Pads of the fingers.
    pub pads: Pads,
    /// Block with a hole on the table, if there is one.
    pub fixture: Option<Fixture>,
}

/// The pads of the fingers.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Pads {
    /// Boxes in Rapier's rigid contact: fast, without tactile sensing.
    #[default]
    Rigid,
    /// Pads with compliant contact.
    Soft(SoftPads),
}

/// Gel pads, modelled as an elastic foundation of bristles.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SoftPads {
    /// Undeformed shape; its extents are those of the gripper's pads.
    pub outline: PadOutline,
    /// Young's modulus (Pa).
    pub young: f64,
    /// Coefficients of the elastic foundation.
    pub foundation: ElasticFoundation,
}

impl SoftPads {
    /// Pads of a `sensor` whose gel has the properties of `calibration`.
    pub fn new(sensor: &Sensor, calibration: &Calibration) -> Self {
        let foundation = calibration.elastic_foundation.unwrap_or_default();
        Self { outline: sensor.outline, young: calibration.young, foundation }
    }

    /// Rigid flat pads of `gripper` on a soft object with `moduli`, whose compliance the elastic
    /// foundation represents. Its forces are those of an elastic ball of `radius` (m) on a rigid
    /// plane by Hertz and Mindlin (Johnson 1985, ch. 4 and 7). The tangential stiffness 8 G* a of
    /// the ball is distributed over the area π 2Rδ of its overlap with the undeformed face.
    pub fn on_elastic(gripper: &Gripper, moduli: Moduli, radius: f64) -> Self {
        let outline = PadOutline {
            length: gripper.pad_length,
            width: gripper.pad_width,
            thickness: gripper.pad_thickness,
            radius_along: f64::INFINITY,
            radius_across: f64::INFINITY,
            rim_width: 0.0,
            rim_radius: 0.0,
        };
        let (young, poisson) = (moduli.young, moduli.poisson);
        let coupling = 5.0 / 6.0;
        // Hertz's energy 8/15 E* √R δ^(5/2) over the foundation's E h³ (2πRδ³/3h⁴)^(5/6),
        // independent of δ.
        let normal = 8.0 / 15.0 / (1.0 - poisson * poisson) / (TAU / 3.0).powf(coupling)
            * (outline.thickness / radius).cbrt();
        let shear = 8.0 * moduli.shear() / (2.0 - poisson) / young / TAU.sqrt();
        Self {
            outline,
            young,
            foundation: ElasticFoundation { normal, coupling, shear, spread: 0.5 },
        }
    }
}

/// A parallel-jaw gripper whose pads have the outline of a GelSight Mini's gel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Gripper {
    /// Extent of a pad across the fingers, along the wrist's y (m).
    pub pad_width: f64,
    /// Extent of a pad along the fingers, along the wrist's z (m).
    pub pad_length: f64,
    /// Thickness of a pad (m).
    pub pad_thickness: f64,
    /// Mass of one finger (kg).
    pub finger_mass: f64,
    /// Distance between the pad faces of the open gripper (m).
    pub max_opening: f64,
    /// Largest grip force of one finger (N).
    pub max_force: f64,
    /// Largest rate of change of the grip force (N/s), in tasks whose grip does not change by
    /// factors.
    pub max_force_rate: f64,
    /// Speed of a free finger under any grip force (m/s).
    pub closing_speed: f64,
    /// Largest speed of the wrist along each axis (m/s).
    pub max_speed: f64,
    /// Largest yaw rate of the wrist (rad/s).
    pub max_yaw_rate: f64,
    /// Largest acceleration of the wrist along each axis (m/s²).
    pub max_acceleration: f64,
    /// Largest yaw acceleration of the wrist (rad/s²).
    pub max_yaw_acceleration: f64,
    /// Stiffness of the spring that keeps the fingers centred (N/m); without it, two force-driven
    /// fingers drift along the grip axis.
    pub centering_stiffness: f64,
}

impl Default for Gripper {
    fn default() -> Self {
        Self {
            pad_width: 0.020_75,
            pad_length: 0.025_25,
            pad_thickness: 0.004,
            finger_mass: 0.1,
            max_opening: OPENING,
            max_force: 40.0,
            // From zero to the largest force in 0.4 s. If the grip could reverse within one control
            // step, the next wrong action would undo it, and so would any exploration noise.
            max_force_rate: 100.0,
            closing_speed: 0.1,
            max_speed: 0.25,
            max_yaw_rate: 2.0,
            max_acceleration: 5.0,
            max_yaw_acceleration: 40.0,
            centering_stiffness: 2.0e4,
        }
    }
}

/// Box of tool-centre positions (m). The table's top is the plane z = 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Workspace {
    /// Lower corner (m); its z keeps the pads off the table.
    pub low: [f64; 3],
    /// Upper corner (m).
    pub high: [f64; 3],
}

impl Default for Workspace {
    fn default() -> Self {
        Self { low: [-0.15, -0.15, 0.014], high: [0.15, 0.15, 0.25] }
    }
}

/// Time step and solver settings of Rapier.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Physics {
    /// Duration of one command (s).
    pub control_period: f64,
    /// Duration of one Rapier step (s); a whole number of them fills the control period.
    pub time_step: f64,
    /// Solver iterations per step. Rapier takes each as a substep, which may last 1.05 ms at most.
    pub iterations: usize,
    /// Gravity along −z (m/s²).
    pub gravity: f64,
}

impl Default for Physics {
    fn default() -> Self {
        Self { control_period: 0.04, time_step: 1.0 / 250.0, iterations: 4, gravity: 9.81 }
    }
}

/// Number among the settings of a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundedNumber {
    /// Its mapping and its name there, such as `gripper.max_force`.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
    /// Least and greatest allowed value.
    pub bounds: [f64; 2],
    /// SI unit; empty for a count.
    pub unit: &'static str,
    /// Meaning, as a phrase.
    pub doc: &'static str,
}

impl BoundedNumber {
    fn new(
        (name, value, bounds, unit, doc): (&'static str, f64, [f64; 2], &'static str, &'static str),
    ) -> Self {
        Self { name, value, bounds, unit, doc }
    }
}

impl SceneConfig {
    /// Returns the settings with soft pads, and a gripper whose pads have the same extents.
    #[must_use]
    pub fn with_pads(mut self, pads: SoftPads) -> Self {
        self.gripper.pad_width = pads.outline.width;
        self.gripper.pad_length = pads.outline.length;
        self.gripper.pad_thickness = pads.outline.thickness;
        self.pads = Pads::Soft(pads);
        self
    }

    /// Numbers of the gripper and of the solver.
    pub fn numbers(&self) -> Vec<BoundedNumber> {
        [&self.gripper.numbers()[..], &self.physics.numbers()].concat()
    }

    /// Checks all settings; the error names the first one out of its range.
    pub fn validate(&self) -> Result<()> {
        for BoundedNumber { name, value, bounds: [low, high], .. } in self.numbers() {
            within(name, value, [low, high])?;
        }
        let p = &self.physics;
        let steps = p.control_period / p.time_step;
        if (steps - steps.round()).abs() > 1e-6 || steps < 0.5 {
            let found = format!("{steps} steps of {} s in {} s", p.time_step, p.control_period);
            return Err(Error::invalid("physics.time_step", found, "a whole number of steps"));
        }
        let substep = p.time_step / p.iterations as f64;
        if substep > LONGEST_SUBSTEP {
            let expected = format!(
                "{} or more with steps of {} s: substeps of {LONGEST_SUBSTEP} s at most",
                (p.time_step / LONGEST_SUBSTEP).ceil(),
                p.time_step
            );
            return Err(Error::invalid("physics.iterations", p.iterations, expected));
        }
        if let Pads::Soft(pads) = &self.pads {
            pads.validate(&self.gripper)?;
        }
        self.workspace.validate(&self.gripper)
    }
}

impl SoftPads {
    fn validate(&self, gripper: &Gripper) -> Result<()> {
        let outline = self.outline.validated()?;
        within("pads.young", self.young, YOUNG).map_err(|error| match unit_of(self.young) {
            Some((unit, factor)) => {
                let pascals = (factor * self.young).round();
                error.hinting(&format!("it is in Pa: {} {unit} is {pascals:e}", self.young))
            }
            None => error,
        })?;
        let extents = [outline.width, outline.length, outline.thickness];
        let expected = [gripper.pad_width, gripper.pad_length, gripper.pad_thickness];
        if extents == expected {
            return Ok(());
        }
        let expected = format!("the gripper's {expected:?} m");
        Err(Error::invalid("pads.outline", format!("{extents:?} m"), expected))
    }
}

impl Gripper {
    fn numbers(&self) -> [BoundedNumber; 13] {
        [
            (
                "gripper.pad_width",
                self.pad_width,
                [0.001, 0.1],
                "m",
                "extent of a pad across the finger; that of the sensor",
            ),
            (
                "gripper.pad_length",
                self.pad_length,
                [0.001, 0.1],
                "m",
                "extent of a pad along the finger; that of the sensor",
            ),
            (
                "gripper.pad_thickness",
                self.pad_thickness,
                [0.0005, 0.02],
                "m",
                "thickness of a pad; that of the sensor",
            ),
            ("gripper.finger_mass", self.finger_mass, [0.001, 10.0], "kg", "mass of one finger"),
            (
                "gripper.max_opening",
                self.max_opening,
                [0.001, 0.5],
                "m",
                "distance between the pads of the open gripper",
            ),
            (
                "gripper.max_force",
                self.max_force,
                [0.01, 200.0],
                "N",
                "largest grip force of one finger",
            ),
            (
                "gripper.max_force_rate",
                self.max_force_rate,
                [0.1, 1e5],
                "N/s",
                "largest rate of the grip force, where the action sets the force",
            ),
            (
                "gripper.closing_speed",
                self.closing_speed,
                [0.001, 5.0],
                "m/s",
                "speed of a finger that touches nothing",
            ),
            (
                "gripper.max_speed",
                self.max_speed,
                [0.001, 5.0],
                "m/s",
                "largest speed of the wrist along each axis",
            ),
            (
                "gripper.max_yaw_rate",
                self.max_yaw_rate,
                [0.0, 50.0],
                "rad/s",
                "largest yaw rate of the wrist",
            ),
            (
                "gripper.max_acceleration",
                self.max_acceleration,
                [0.1, 1000.0],
                "m/s²",
                "largest acceleration of the wrist along each axis",
            ),
            (
                "gripper.max_yaw_acceleration",
                self.max_yaw_acceleration,
                [0.1, 10_000.0],
                "rad/s²",
                "largest yaw acceleration of the wrist",
            ),
            (
                "gripper.centering_stiffness",
                self.centering_stiffness,
                [0.0, 1e6],
                "N/m",
                "stiffness of the spring that keeps the fingers centred",
            ),
        ]
        .map(BoundedNumber::new)
    }
}

impl Physics {
    fn numbers(&self) -> [BoundedNumber; 4] {
        [
            (
                "physics.control_period",
                self.control_period,
                [1e-3, 1.0],
                "s",
                "duration of a control step",
            ),
            (
                "physics.time_step",
                self.time_step,
                [1e-4, 1.0 / 60.0],
                "s",
                "duration of a step of Rapier; a whole number of them is a control step",
            ),
            (
                "physics.iterations",
                self.iterations as f64,
                [1.0, 64.0],
                "",
                "substeps of a step of Rapier; each lasts 1.05 ms at most",
            ),
            (
                "physics.gravity",
                self.gravity,
                [0.0, 100.0],
                "m/s²",
                "acceleration by weight, along -z",
            ),
        ]
        .map(BoundedNumber::new)
    }

    /// Number of Rapier steps in one control period.
    pub fn steps(&self) -> usize {
        (self.control_period / self.time_step).round() as usize
    }
}

impl Workspace {
    fn validate(&self, gripper: &Gripper) -> Result<()> {
        for axis in 0..3 {
            within("workspace.low", self.low[axis], [-1.0, 1.0])?;
            within("workspace.high", self.high[axis], [-1.0, 1.0])?;
            if self.low[axis] > self.high[axis] {
                let found = format!("{:?} above {:?}", self.low, self.high);
                return Err(Error::invalid("workspace", found, "low ≤ high on every axis"));
            }
        }
        if self.low[2] <= 0.5 * gripper.pad_length {
            let expected = format!(
                "more than half of the pad's length ({} m) above the table",
                0.5 * gripper.pad_length
            );
            return Err(Error::invalid("workspace.low[2]", format!("{} m", self.low[2]), expected));
        }
        Ok(())
    }

    /// Returns the nearest point inside (m).
    pub fn clamp(&self, point: &Vector3<f64>) -> Vector3<f64> {
        point.sup(&Vector3::from(self.low)).inf(&Vector3::from(self.high))
    }
}

/// Longest substep (s), which admits steps of 1/120 s in eight. With 1 ms an untouched object of
/// the catalogue rolls by 1 mm at most until it rests; with 2 ms by 17 mm, with 1/60 s by 42 mm,
/// and held ones creep.
const LONGEST_SUBSTEP: f64 = 1.05e-3;
/// Bounds of a gel's Young's modulus (Pa).
const YOUNG: [f64; 2] = [1e3, 1e8];

/// Unit in which a Young's modulus that is too low in Pa would be that of a gel, and its size (Pa).
fn unit_of(young: f64) -> Option<(&'static str, f64)> {
    let unit = if young < 10.0 { ("MPa", 1e6) } else { ("kPa", 1e3) };
    (young > 0.0 && young < YOUNG[0]).then_some(unit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::Sensor;

    #[test]
    fn the_default_pads_have_the_outline_of_a_gelsight_mini() {
        let (pad, gripper) = (Sensor::named("gelsight-mini").unwrap().outline, Gripper::default());
        let found = [gripper.pad_width, gripper.pad_length, gripper.pad_thickness];
        assert_eq!(found, [pad.width, pad.length, pad.thickness]);
    }

    #[test]
    fn a_modulus_in_another_unit_is_told_in_pascals() {
        let sensor = Sensor::named("gelsight-mini").unwrap();
        let gel = SoftPads::new(&sensor, sensor.calibration(None).unwrap());
        let message = |young: f64| {
            let pads = Pads::Soft(SoftPads { young, ..gel });
            SceneConfig { pads, ..SceneConfig::default() }.validate().unwrap_err().to_string()
        };
        let expected = "expected 1000 to 100000000";
        let found = message(0.3);
        assert_eq!(
            found,
            format!("pads.young: found 0.3, {expected}; it is in Pa: 0.3 MPa is 3e5")
        );
        assert!(message(300.0).ends_with("; it is in Pa: 300 kPa is 3e5"), "{}", message(300.0));
        for young in [-1.0, 0.0, 1e9] {
            assert!(message(young).ends_with(expected), "{}", message(young));
        }
    }

    #[test]
    fn a_setting_out_of_range_is_named() {
        let message = |change: fn(&mut SceneConfig)| {
            let mut config = SceneConfig::default();
            change(&mut config);
            config.validate().unwrap_err().to_string()
        };
        let force = message(|c| c.gripper.max_force = f64::NAN);
        assert_eq!(force, "gripper.max_force: found NaN, expected 0.01 to 200");
        assert!(message(|c| c.physics.time_step = 0.003).contains("whole number of steps"));
        assert!(
            message(|c| c.physics.iterations = 3)
                .contains("physics.iterations: found 3, expected 4")
        );
        assert!(message(|c| c.workspace.low[2] = 0.01).contains("workspace.low[2]"));
        assert!(message(|c| c.workspace.low[0] = 0.5).contains("low ≤ high"));
    }
}
