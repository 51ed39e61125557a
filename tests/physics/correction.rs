//! Soft pads corrected towards a better model once per control step.

use nalgebra::{Isometry3, Vector3};
use ruffini_core::{
    compliance::{Compliance, ComplianceOptions},
    deformation::{History, Law, Moduli, Press, SoftBody, Wrench},
    geometry::Shape,
    scene::{Command, Scene},
    sensor::Sensor,
};

use crate::foundation::{ball, gripped, hold, soft};

const RADIUS: f64 = 0.015;

/// Gel under a ball with a force law unlike that of the elastic foundation: a power law in depth,
/// and a linear spring sideways from the place of first contact up to Coulomb's limit. Both act at
/// the deepest point of the contact.
#[derive(Clone, Copy)]
struct PowerLawGel {
    /// Force at 1 mm (N).
    force: f64,
    exponent: f64,
    /// Sideways stiffness (N/m).
    shear: f64,
}

impl PowerLawGel {
    /// Force and torque on the pad under a ball at `pose` whose first contact was at `touched` (m).
    fn wrench(&self, pose: &Isometry3<f64>, touched: &Vector3<f64>) -> Wrench {
        let depth = RADIUS - pose.translation.z;
        if depth <= 0.0 {
            return Wrench::default();
        }
        let normal = self.force * (depth / 1e-3).powf(self.exponent);
        let offset = pose.translation.vector - touched;
        let mut force = Vector3::new(self.shear * offset.x, self.shear * offset.y, 0.0);
        let limit = 0.8 * normal;
        if force.norm() > limit {
            force *= limit / force.norm();
        }
        force.z = -normal;
        let place = Vector3::new(pose.translation.x, pose.translation.y, -depth);
        Wrench { force, torque: place.cross(&force) }
    }
}

/// A gel with the place of first contact of the ball for each finger.
struct BallTouch {
    gel: PowerLawGel,
    touched: [Option<Vector3<f64>>; 2],
}

impl BallTouch {
    fn new(gel: PowerLawGel) -> Self {
        Self { gel, touched: [None; 2] }
    }

    /// Wrench of a finger's gel in the present state of the scene.
    fn wrench(&mut self, scene: &Scene, finger: usize) -> Wrench {
        let state = &scene.state().fingers[finger];
        if !state.touches() {
            self.touched[finger] = None;
            return Wrench::default();
        }
        let here = state.object.translation.vector;
        let touched = self.touched[finger].get_or_insert(here);
        self.gel.wrench(&state.object, touched)
    }

    /// Takes a control step, then corrects both fingers.
    fn step(&mut self, scene: &mut Scene, command: &Command) {
        scene.step(command);
        for finger in 0..2 {
            let wrench = self.wrench(scene, finger);
            scene.correct(finger, &wrench);
        }
    }
}

/// Gels softer and stiffer than the elastic foundation, which bears 10 N under a ball of 15 mm at 1
/// mm.
fn gels() -> Vec<PowerLawGel> {
    let mut gels = Vec::new();
    for force in [6.0, 10.0, 14.0] {
        for (exponent, shear) in [(1.7, 2000.0), (1.9, 4000.0), (2.2, 6000.0)] {
            gels.push(PowerLawGel { force, exponent, shear });
        }
    }
    gels
}

/// |model − scene| over the grip force, of the worse finger.
fn defect(scene: &Scene, touch: &mut BallTouch, grip: f64) -> f64 {
    let of = |finger: usize, touch: &mut BallTouch| {
        let found = scene.state().fingers[finger].wrench.force;
        (touch.wrench(scene, finger).force - found).norm() / grip
    };
    of(0, touch).max(of(1, touch))
}

fn command_at(t: f64) -> Command {
    let velocity =
        Vector3::new(0.1 * (7.0 * t).sin(), 0.1 * (9.0 * t).sin(), 0.03 + 0.1 * (11.0 * t).cos());
    Command { velocity, yaw_rate: (5.0 * t).sin(), grip: 0.0 }
}

#[test]
fn in_steady_holding_the_wrench_is_the_models() {
    for gel in gels() {
        for (mass, grip) in [(0.005, 1.0), (0.1, 5.0), (0.5, 20.0)] {
            let mut scene = gripped(&soft(), &ball(), mass, 0.5 * grip);
            let mut touch = BallTouch::new(gel);
            scene.set_gravity(9.81);
            let steady = Command { grip, ..Command::default() };
            for _ in 0..50 {
                touch.step(&mut scene, &steady);
            }
            let (before, found) = (scene.state(), defect(&scene, &mut touch, grip));
            let PowerLawGel { force, exponent, shear } = gel;
            let name = format!("{force} N, δ^{exponent}, {shear} N/m, {mass} kg");
            println!("{name}: {:.4} %", 100.0 * found);
            assert!(found < 0.03, "{name}: off by {found:.3} of the grip");
            let speed = before.object.velocity.norm();
            assert!(speed < 1e-3, "{name}: still moves at {speed} m/s");
        }
    }
}

#[test]
fn a_minute_of_corrections_moves_nothing() {
    for mass in [0.005, 0.5] {
        let grip = 40.0 * mass + 2.0;
        let mut scene = gripped(&soft(), &ball(), mass, grip);
        let mut touch = BallTouch::new(PowerLawGel { force: 6.0, exponent: 1.6, shear: 2000.0 });
        scene.set_gravity(9.81);
        let steady = Command { grip, ..Command::default() };
        for _ in 0..50 {
            touch.step(&mut scene, &steady);
        }
        let before = scene.state().object_in_wrist();
        for _ in 0..1500 {
            touch.step(&mut scene, &steady);
        }
        let after = scene.state().object_in_wrist();
        let moved = (after.translation.vector - before.translation.vector).norm();
        let turned = after.rotation.angle_to(&before.rotation);
        assert!(moved < 2e-6 && turned < 2e-4, "{mass} kg: {moved} m, {turned} rad");
    }
}

#[test]
fn lifted_and_shaken_under_correction_nothing_is_lost() {
    for gel in gels() {
        for (mass, grip) in [(0.005, 1.0), (0.02, 5.0), (0.1, 5.0), (0.5, 20.0)] {
            let mut scene = gripped(&soft(), &ball(), mass, grip);
            let mut touch = BallTouch::new(gel);
            scene.set_gravity(9.81);
            let before = scene.state().object_in_wrist().translation.vector;
            let mut worst = 0f64;
            for i in 0..100 {
                touch.step(&mut scene, &Command { grip, ..command_at(0.04 * f64::from(i)) });
                if i > 25 {
                    worst = worst.max(defect(&scene, &mut touch, grip));
                }
            }
            let state = scene.state();
            let moved = (state.object_in_wrist().translation.vector - before).norm();
            assert!(state.failure.is_none());
            assert!(moved < 3e-3, "{mass} kg: moved by {moved} m in the hand");
            assert!(worst < 0.04, "{mass} kg: forces apart by {worst} of the grip");
        }
    }
}

#[test]
fn a_touch_that_is_lost_takes_its_correction_along() {
    let mut scene = gripped(&soft(), &ball(), 0.05, 5.0);
    let mut touch = BallTouch::new(PowerLawGel { force: 14.0, exponent: 1.7, shear: 6000.0 });
    for _ in 0..20 {
        touch.step(&mut scene, &Command { grip: 5.0, ..Command::default() });
    }
    hold(&mut scene, -5.0, 0.4);
    for finger in scene.state().fingers {
        assert_eq!(finger.wrench, Wrench::default());
    }
    let scaled = |scene: &Scene| scene.state().fingers.map(|finger| finger.object.translation.z);
    hold(&mut scene, 5.0, 1.0);
    let depth = scaled(&scene).map(|z| RADIUS - z);
    let fresh = scaled(&gripped(&soft(), &ball(), 0.05, 5.0)).map(|z| RADIUS - z);
    for (found, fresh) in depth.into_iter().zip(fresh) {
        assert!((found / fresh - 1.0).abs() < 0.02, "{found} m, without a correction {fresh} m");
    }
}

#[test]
fn nonsense_from_a_model_is_bounded() {
    for wild in [1e9, -1e9, 0.0] {
        let mut scene = gripped(&soft(), &ball(), 0.05, 5.0);
        for _ in 0..50 {
            for finger in 0..2 {
                let force = Vector3::new(wild, -wild, -wild);
                scene.correct(finger, &Wrench { force, torque: force });
            }
            scene.step(&Command { grip: 5.0, ..Command::default() });
            let state = scene.state();
            assert!(state.failure.is_none());
            assert!(state.object.velocity.norm() < 5.0, "{} m/s", state.object.velocity.norm());
        }
    }
}

/// The gel as condensed finite elements, with its contact history.
struct LinearGel {
    model: Compliance,
    histories: [Option<History>; 2],
}

impl LinearGel {
    fn new() -> Self {
        let sensor = Sensor::named("gelsight-mini").unwrap();
        let (pad, calibration) = (sensor.pad(1000).unwrap(), &sensor.calibrations[0]);
        let moduli = Moduli::from(calibration);
        let body = SoftBody::new(pad.mesh, Law::default(), moduli, &pad.base).unwrap();
        let model =
            Compliance::new(body, ComplianceOptions { friction: 0.8, corrections: 0 }).unwrap();
        Self { model, histories: [None, None] }
    }

    /// Wrench on the pad of a finger in the present state of the scene.
    fn wrench(&mut self, scene: &Scene, finger: usize) -> Wrench {
        let pose = scene.state().fingers[finger].object;
        let ball = Shape::Sphere { radius: RADIUS };
        let mut press = Press::along(vec![ball], vec![vec![pose]]).unwrap();
        if let Some(history) = self.histories[finger].take() {
            press = press.after(history).unwrap();
        }
        let frame = self.model.solve_path(&press).pop().unwrap().unwrap();
        self.histories[finger] = Some(frame.history);
        frame.wrench
    }
}

#[test]
fn the_wrench_becomes_that_of_the_condensed_gel() {
    for (mass, grip) in [(0.02, 1.0), (0.1, 5.0), (0.3, 10.0)] {
        let mut scene = gripped(&soft(), &ball(), mass, grip);
        let mut gel = LinearGel::new();
        let mut off = [0.0; 2];
        for step in 0..60 {
            if step == 15 {
                scene.set_gravity(9.81);
            }
            scene.step(&Command { grip, ..Command::default() });
            let before = scene.state().fingers.map(|finger| finger.wrench.force);
            for finger in 0..2 {
                let wrench = gel.wrench(&scene, finger);
                off[finger] = (wrench.force - before[finger]).norm() / grip;
                scene.correct(finger, &wrench);
            }
            if step % 5 == 0 {
                println!("{mass} kg, step {step}: {:.4} {:.4}", off[0], off[1]);
            }
        }
        assert!(off.iter().all(|off| *off < 0.03), "{mass} kg: off by {off:?} of the grip");
    }
}
