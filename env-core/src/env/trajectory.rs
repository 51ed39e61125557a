//! Trajectory of the object and the distractors relative to the pads, thinned to the poses that
//! matter to the contact.

use nalgebra::Isometry3;

/// Poses of the object and then of the distractors in the frame of each pad (m).
pub(super) type PosesInPads = [Vec<Isometry3<f64>>; 2];

/// Motion relative to a pad after which another pose within a control step is kept (m). The path
/// between poses further apart could pass through the gel where the object moves around it. The
/// pose at the end of the step is always kept.
pub(super) const COARSE: f64 = 1e-3;
/// Motion after which another pose is kept while the hand closes on the object before an episode
/// starts (m); friction depends on this whole trajectory. Compared with keeping all poses, the
/// markers differ by 0.3 % in the median of 32 starts of HoldStill and by at most 1.4 %; with 0.1
/// mm, by 5 % and 49 %.
pub(super) const FINE: f64 = 1e-5;
/// Lever arm that converts a rotation to a motion (m): the edge of a pad is 13 mm from its centre.
const ARM: f64 = 0.013;

/// Poses of the object from one press to the next, oldest first.
pub(super) struct Trajectory {
    coarseness: f64,
    start: PosesInPads,
    last: PosesInPads,
    poses: Vec<PosesInPads>,
}

impl Trajectory {
    /// Creates a trajectory that begins at `start`, which is not one of its poses. Further poses
    /// are kept if they are more than `coarseness` (m) apart.
    pub(super) fn from(start: PosesInPads, coarseness: f64) -> Self {
        Self { coarseness, last: start.clone(), start, poses: Vec::new() }
    }

    /// Adds `poses` if they are more than the spacing away from the last ones kept.
    pub(super) fn go_on(&mut self, poses: PosesInPads) {
        let mut moves = self.last.iter().flatten().zip(poses.iter().flatten());
        if moves.any(|(from, to)| motion(from, to) > self.coarseness) {
            self.arrive(poses);
        }
    }

    /// Adds `poses`, the end of the trajectory.
    pub(super) fn arrive(&mut self, poses: PosesInPads) {
        if self.poses.is_empty() || self.last != poses {
            self.last.clone_from(&poses);
            self.poses.push(poses);
        }
    }

    /// Poses at the beginning, before the first of [`Trajectory::poses`].
    pub(super) fn start(&self) -> PosesInPads {
        self.start.clone()
    }

    /// Poses kept.
    pub(super) fn poses(&self) -> &[PosesInPads] {
        &self.poses
    }
}

/// Approximate motion of a body relative to a pad (m).
fn motion(from: &Isometry3<f64>, to: &Isometry3<f64>) -> f64 {
    let step = to * from.inverse();
    step.translation.vector.norm() + ARM * step.rotation.angle()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use nalgebra::Vector3;

    use super::*;

    /// Poses of an object that circles a pad, `turn` (rad) after the beginning.
    fn rolled(turn: f64) -> PosesInPads {
        let pose =
            Isometry3::rotation(Vector3::x() * turn) * Isometry3::translation(0.0, 0.0, 0.02);
        [vec![pose], vec![pose]]
    }

    #[test]
    fn a_long_trajectory_is_kept_in_short_pieces_and_a_short_one_as_its_final_pose() {
        let mut long = Trajectory::from(rolled(0.0), COARSE);
        (1..100).for_each(|i| long.go_on(rolled(0.01 * PI * f64::from(i))));
        long.arrive(rolled(PI));
        let ends: Vec<_> = [long.start()].iter().chain(long.poses()).cloned().collect();
        // A path of 41 mm in steps of 0.41 mm, of which every third pose is kept.
        assert_eq!(ends.len(), 35);
        assert!(ends.windows(2).all(|ends| motion(&ends[0][0][0], &ends[1][0][0]) < 2.0 * COARSE));
        let mut short = Trajectory::from(rolled(0.0), COARSE);
        (1..10).for_each(|i| short.go_on(rolled(1e-3 * f64::from(i))));
        short.arrive(rolled(1e-2));
        assert_eq!(short.poses(), [rolled(1e-2)]);
    }

    #[test]
    fn what_stands_still_has_one_pose() {
        let mut still = Trajectory::from(rolled(0.0), 0.0);
        still.go_on(rolled(0.0));
        still.arrive(rolled(0.0));
        assert_eq!(still.poses(), [rolled(0.0)]);
    }
}
