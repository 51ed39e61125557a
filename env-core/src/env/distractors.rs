//! Distractors: objects beside the one to be grasped.

use std::f64::consts::PI;

use nalgebra::{Isometry3, Vector2};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::Setup;
use crate::{
    scene::MOST_DISTRACTORS,
    task::{Distractor, EpisodeParameters, Range},
};

/// Least and greatest gap between the object and a distractor (m), by the upright cylinders that
/// contain them.
const GAP: Range = [0.01, 0.06];
/// Draws of a place until it is free.
const DRAWS: usize = 100;

/// Draws the distractors of an episode from `random`, at rest on the table beside the object at
/// `pose` (m), none nearer to another than the least gap. If no free place is found, the next is
/// farther out than all others.
pub(super) fn beside(
    setup: &Setup,
    mut random: ChaCha8Rng,
    parameters: &EpisodeParameters,
    pose: &Isometry3<f64>,
) -> [Option<Distractor>; MOST_DISTRACTORS] {
    let (config, models) = (&setup.config, &setup.models);
    let middle = pose.translation.vector.xy();
    let radius = models[parameters.object].rest_radius(parameters.scale);
    let mut taken = vec![(middle, radius)];
    let mut distractors = [None; MOST_DISTRACTORS];
    for distractor in distractors.iter_mut().take(config.task.distractors()) {
        let object = random.random_range(0..models.len());
        let mut uniform = |[low, high]: Range| low + (high - low) * random.random::<f64>();
        let (mass, scale) = (uniform(config.mass), uniform(config.size));
        let (yaw, own) = (uniform(config.yaw), models[object].rest_radius(scale));
        let at =
            |distance: f64, angle: f64| middle + distance * Vector2::new(angle.cos(), angle.sin());
        let mut draw = || at(radius + own + uniform(GAP), uniform([-PI, PI]));
        let room = |place: &Vector2<f64>| {
            let room =
                |(other, radius): &(Vector2<f64>, f64)| (place - other).norm() - radius - own;
            taken.iter().map(room).fold(f64::INFINITY, f64::min)
        };
        let mut places = (0..DRAWS).map(|_| draw());
        // The first disc is the object's own, from which the gap is kept but for rounding.
        let free = places.find(|place| room(place) > 0.999 * GAP[0]);
        let place = free.unwrap_or_else(|| {
            let ends = taken.iter().map(|(other, radius)| (other - middle).norm() + radius);
            at(ends.fold(0.0, f64::max) + own + GAP[0], PI * taken.len() as f64 / 2.0)
        });
        taken.push((place, own));
        let pose = models[object].rest(scale, place.x, place.y, yaw);
        *distractor = Some(Distractor { object, scale, mass, pose });
    }
    distractors
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;
    use crate::{env::Row, task::TaskConfig};

    fn setup(json: &str) -> Setup {
        Setup::new(TaskConfig::from_json(json).unwrap()).unwrap()
    }

    /// Parameters of the first episode of a row with this seed.
    fn drawn(setup: &Setup, seed: u64) -> EpisodeParameters {
        let mut row = Row::new(seed);
        row.reset(setup).unwrap();
        row.state().unwrap().1
    }

    /// Middles and radii of what lies on the table, the object last.
    fn discs(
        setup: &Setup,
        drawn: &EpisodeParameters,
        object: &Isometry3<f64>,
    ) -> Vec<(Vector2<f64>, f64)> {
        let radius = |object: usize, scale| setup.models[object].rest_radius(scale);
        let of = |d: &Distractor| (d.pose.translation.vector.xy(), radius(d.object, d.scale));
        let object = (object.translation.vector.xy(), radius(drawn.object, drawn.scale));
        drawn.distractors.iter().flatten().map(of).chain([object]).collect()
    }

    #[test]
    fn distractors_lie_apart_and_leave_the_object_as_it_is() {
        let [none, most] =
            [0, 4].map(|count| setup(&format!(r#"{{"tactile": "none", "distractors": {count}}}"#)));
        for seed in 0..20 {
            let (alone, beside) = (drawn(&none, seed), drawn(&most, seed));
            assert_eq!(alone, EpisodeParameters { distractors: alone.distractors, ..beside });
            assert_eq!(alone.distractors, [None; MOST_DISTRACTORS]);
            assert!(beside.distractors.iter().all(Option::is_some), "{beside:?}");
            let mut row = Row::new(seed);
            row.reset(&most).unwrap();
            let discs = discs(&most, &beside, &row.state().unwrap().0.object.pose);
            for (i, (a, of_a)) in discs.iter().enumerate() {
                for (b, of_b) in &discs[..i] {
                    let gap = (a - b).norm() - of_a - of_b;
                    // The scene has places in single precision.
                    assert!(gap > 0.99 * GAP[0], "seed {seed}: {gap} m");
                }
                let from_object = (a - discs[4].0).norm() - of_a - discs[4].1;
                assert!(from_object < 1.01 * GAP[1], "seed {seed}: {from_object} m");
            }
        }
    }

    #[test]
    fn long_objects_lie_apart_as_well() {
        let rod = r#"{"shape": "cuboid", "half_extents": [0.15, 0.01, 0.01]}"#;
        let json =
            format!(r#"{{"tactile": "none", "distractors": 4, "size": 1, "objects": [{rod}]}}"#);
        let setup = setup(&json);
        for seed in 0..5 {
            let drawn = drawn(&setup, seed);
            let places: Vec<_> = drawn.distractors.iter().flatten().map(|d| d.pose).collect();
            assert_eq!(places.len(), 4);
            for (i, a) in places.iter().enumerate() {
                for b in &places[..i] {
                    let apart = (a.translation.vector - b.translation.vector).norm();
                    assert!(apart > 0.3, "seed {seed}: {apart} m");
                }
            }
        }
    }

    #[test]
    fn the_stream_alone_decides() {
        let setup = setup(r#"{"tactile": "none", "distractors": 3}"#);
        let (parameters, pose) = (drawn(&setup, 1), Isometry3::identity());
        let [one, two, other] = [7, 7, 8]
            .map(|seed| beside(&setup, ChaCha8Rng::seed_from_u64(seed), &parameters, &pose));
        assert_eq!(one, two);
        assert_ne!(one, other);
    }
}
