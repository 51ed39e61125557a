//! The way of an object past the pads, as coarse as what they remember of it allows.

use nalgebra::Isometry3;

use crate::tactile::Finger;

/// Pose of the object in the frame of each pad (m).
pub(super) type PosesInPads = [Isometry3<f64>; 2];

/// Motion past a pad from which a pose within a control step is kept (m): a straight line might lead
/// through the gel where the object itself went round it. The end of the step is kept in any case.
pub(super) const COARSE: f64 = 1e-3;
/// The same on the way into the hand, all of which friction remembers (m). Against all poses markers are
/// off by 0.3 % in the median of 32 starts of HoldStill, and by 1.4 % at most; 5 and 49 % with 0.1 mm.
pub(super) const FINE: f64 = 1e-5;
/// Distance from a pad's middle at which a turn counts as motion (m): its corners are 13 mm away.
const ARM: f64 = 0.013;

/// Poses by which the fingers are led, oldest first.
pub(super) struct Way {
    coarseness: f64,
    start: PosesInPads,
    last: PosesInPads,
    poses: Vec<PosesInPads>,
}

impl Way {
    /// A way that begins at `start`, which is not part of it, of poses that are `coarseness` (m) apart.
    pub(super) fn from(start: PosesInPads, coarseness: f64) -> Self {
        Self { coarseness, start, last: start, poses: Vec::new() }
    }

    /// A way that goes on from where `fingers` last saw the object.
    pub(super) fn after(fingers: &[Finger; 2]) -> Self {
        Self::from(fingers.each_ref().map(|finger| *finger.last()), COARSE)
    }

    /// The object has come to `poses`, which are kept if it is far from the last that were.
    pub(super) fn go_on(&mut self, poses: PosesInPads) {
        if self.last.iter().zip(&poses).any(|(from, to)| motion(from, to) > self.coarseness) {
            self.arrive(poses);
        }
    }

    /// The object has come to the end of its way, `poses`, which are kept.
    pub(super) fn arrive(&mut self, poses: PosesInPads) {
        if self.poses.is_empty() || self.last != poses {
            self.last = poses;
            self.poses.push(poses);
        }
    }

    /// Where it began.
    pub(super) fn start(&self) -> PosesInPads {
        self.start
    }

    /// What was kept.
    pub(super) fn poses(&self) -> &[PosesInPads] {
        &self.poses
    }
}

/// How far the object moves past a pad, about (m).
fn motion(from: &Isometry3<f64>, to: &Isometry3<f64>) -> f64 {
    let step = to * from.inverse();
    step.translation.vector.norm() + ARM * step.rotation.angle()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use nalgebra::Vector3;

    use super::*;

    /// Places on an object's way round a pad, `turn` (rad) after its beginning.
    fn rolled(turn: f64) -> PosesInPads {
        let pose =
            Isometry3::rotation(Vector3::x() * turn) * Isometry3::translation(0.0, 0.0, 0.02);
        [pose; 2]
    }

    #[test]
    fn a_long_way_is_kept_in_short_pieces_and_a_short_one_as_its_end() {
        let mut long = Way::from(rolled(0.0), COARSE);
        (1..100).for_each(|i| long.go_on(rolled(0.01 * PI * f64::from(i))));
        long.arrive(rolled(PI));
        let ends: Vec<_> = [long.start()].iter().chain(long.poses()).copied().collect();
        // A way of 41 mm in steps of 0.41 mm, of which every third is kept.
        assert_eq!(ends.len(), 35);
        assert!(ends.windows(2).all(|ends| motion(&ends[0][0], &ends[1][0]) < 2.0 * COARSE));
        let mut short = Way::from(rolled(0.0), COARSE);
        (1..10).for_each(|i| short.go_on(rolled(1e-3 * f64::from(i))));
        short.arrive(rolled(1e-2));
        assert_eq!(short.poses(), [rolled(1e-2)]);
    }

    #[test]
    fn what_stands_still_has_one_pose() {
        let mut still = Way::from(rolled(0.0), 0.0);
        still.go_on(rolled(0.0));
        still.arrive(rolled(0.0));
        assert_eq!(still.poses(), [rolled(0.0)]);
    }
}
