//! The grasps of the dataset, approached by the gripper of the scene.

use std::f64::consts::PI;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rayon::prelude::*;
use ruffini_core::{
    dataset::{DatasetConfig, Orders, Plan, Unsolved, generate},
    geometry::Shape,
    objects::{GraspSampler, Object, catalogue},
    scene::{Approach, ApproachFailure, ObjectModel},
};

/// Obstacles that keep the gripper from an object's first `count` grasps; reachable ones are left
/// out.
fn obstacles(object: &Object, count: usize) -> Vec<(String, ApproachFailure)> {
    let sampler = GraspSampler::default();
    let model = ObjectModel::new(object.shape.clone()).unwrap();
    let approach = Approach::new(model, sampler.clearance);
    let grasps = sampler.sample(&object.shape, count, object.seed).unwrap().grasps;
    let found = grasps.iter().enumerate().map(|(number, grasp)| {
        let obstacle = approach.obstacle(&grasp.tool, grasp.width).unwrap();
        obstacle.map(|obstacle| (format!("{}/{number:03}", object.name), obstacle))
    });
    found.flatten().collect()
}

#[test]
fn the_gripper_gets_to_the_grasps_that_distances_allow() {
    let objects = catalogue(0);
    let found: Vec<_> = objects.par_iter().flat_map(|object| obstacles(object, 100)).collect();
    assert!(found.is_empty(), "of 6400 grasps the gripper does not get to {found:?}");
}

/// A grasp of a cube with edges of 40 mm at `tool`, contacts `width` (m) apart.
fn cube(tool: Isometry3<f64>, width: f64) -> Option<ApproachFailure> {
    let shape = Shape::Cuboid { half_extents: Vector3::repeat(0.02) };
    Approach::new(ObjectModel::new(shape).unwrap(), 0.005).obstacle(&tool, width).unwrap()
}

#[test]
fn an_object_in_the_way_of_the_hand_is_met() {
    let middle = Isometry3::identity();
    assert_eq!(cube(middle, 0.04), None);
    assert_eq!(cube(Isometry3::translation(0.012, 0.0, 0.0), 0.03), Some(ApproachFailure::Coming));
    assert_eq!(cube(Isometry3::translation(0.0, 0.05, 0.0), 0.04), Some(ApproachFailure::Missed));
}

#[test]
fn a_finger_meets_what_is_wider_above_the_pads() {
    // The cone points down with its rim 30 mm above the grasp: there it is 4.5 mm wider than at the
    // upper ends of the pads, behind which the fingers stand back by 4 mm.
    let cone = ObjectModel::new(Shape::Cone { radius: 0.02, half_height: 0.0385 }).unwrap();
    let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
    let tool = Isometry3::from_parts(Translation3::new(0.0, 0.0, -0.0085), turn);
    let found = Approach::new(cone, 0.005).obstacle(&tool, 0.031).unwrap();
    assert_eq!(found, Some(ApproachFailure::Closing));
}

#[test]
fn a_grasp_that_the_gripper_does_not_get_to_is_listed_and_not_solved() {
    let folder = std::env::temp_dir().join(format!("ruffini-approach-{}", std::process::id()));
    let gels = DatasetConfig::default().gels[..1].to_vec();
    let config = DatasetConfig {
        objects: 1,
        grasps: 2,
        frames: 1,
        truth_nodes: 400,
        model_nodes: 200,
        gels,
        ..DatasetConfig::default()
    };
    let first = |_: &Object, plan: &Plan| {
        Ok(plan.name.ends_with("/000").then(|| ApproachFailure::Coming.to_string()))
    };
    let orders = Orders { obstacle: Some(&first), ..Orders::default() };
    let manifest = generate(&config, &folder, &orders, &|_| true).unwrap().unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
    assert!(manifest.approached);
    let error = "the hand meets the object on its way to the grasp".to_owned();
    let unreached = Unsolved { name: "prism-1/000".to_owned(), frames: 0, error };
    assert_eq!(manifest.unsolved, [unreached]);
    let solved: Vec<_> = manifest.shards[0].grasps.iter().map(|g| (&*g.name, g.frames)).collect();
    assert_eq!(solved, [("prism-1/001", 1)]);
}
