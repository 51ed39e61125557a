//! Lowering of a height map to the objects that press it.
//!
//! Shapes: P pixels, those across the fastest.

use nalgebra::{Isometry3, Point3, Similarity3, Vector3};

use super::{depth, face::PlanGrid, round::lower_to_round};
use crate::geometry::Shape;

/// Pixels along an edge of the tiles that are tested against the object as a whole.
const TILE: u32 = 8;

/// Lowers heights (P) inside of an object to where a line from below enters it.
pub(super) fn lower(heights: &mut [f64], grid: &PlanGrid, shape: &Shape, pose: &Isometry3<f64>) {
    if lower_to_round(heights, grid, shape, pose) {
        return;
    }
    let highest = heights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let [x, y] = [0, 1].map(|axis| 0.5 * f64::from(grid.counts[axis]) * grid.cell[axis]);
    let within = [Point3::new(-x, -y, f64::NEG_INFINITY), Point3::new(x, y, highest)];
    match shape.triangles_near(&Similarity3::from_isometry(*pose, 1.0), &within) {
        Some(triangles) => lower_to_triangles(heights, grid, &triangles),
        None => lower_by_rays(heights, grid, shape, pose),
    }
}

/// Lowers heights (P) inside of the solid whose surface near them consists of `triangles`.
fn lower_to_triangles(heights: &mut [f64], grid: &PlanGrid, triangles: &[[Point3<f64>; 3]]) {
    // The last crossing of the surface below each height, and `true` if a line from below enters.
    let mut crossed = vec![(f64::NEG_INFINITY, false); heights.len()];
    for triangle in triangles {
        let [u, v] = [1, 2].map(|corner| triangle[corner] - triangle[0]);
        let enters = u.x * v.y < u.y * v.x;
        let corners = triangle.map(|corner| corner.z);
        depth::cover_by(triangle, [corners], grid, |pixels, [z]| {
            let row = crossed[pixels.clone()].iter_mut().zip(&heights[pixels]);
            for (k, (last, height)) in (0..).zip(row) {
                let z = z.at(k);
                if last.0 < z && z < *height {
                    *last = (z, enters);
                }
            }
        });
    }
    for (height, (z, enters)) in heights.iter_mut().zip(crossed) {
        if enters {
            *height = z;
        }
    }
}

/// Lowers heights (P) inside of a solid by a ray for each.
fn lower_by_rays(heights: &mut [f64], grid: &PlanGrid, shape: &Shape, pose: &Isometry3<f64>) {
    let [nx, ny] = grid.counts;
    // The frame of the solid.
    let to_solid = pose.inverse();
    let turn = to_solid.rotation.to_rotation_matrix();
    let [across, along, up] = [0, 1, 2].map(|axis| turn.matrix().column(axis).into_owned());
    let place = |i: u32, j: u32, z: f64| {
        let of_row = to_solid.translation.vector + grid.centre(1, j) * along;
        Point3::from(of_row + grid.centre(0, i) * across + z * up)
    };
    let tiles = (0..ny.div_ceil(TILE)).flat_map(|j| (0..nx.div_ceil(TILE)).map(move |i| (i, j)));
    for (i, j) in tiles {
        let columns = i * TILE..((i + 1) * TILE).min(nx);
        let rows = j * TILE..((j + 1) * TILE).min(ny);
        let row = |j: u32| (j * nx + columns.start) as usize..(j * nx + columns.end) as usize;
        let range = rows.clone().flat_map(|j| &heights[row(j)]);
        let [low, high] = range
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], z| [low.min(*z), high.max(*z)]);
        let corner = place(columns.start, rows.start, 0.5 * (low + high));
        let [dx, dy] = grid.cell.map(|cell| f64::from(TILE) * cell);
        let radius = dx.hypot(dy) + 0.5 * (high - low);
        if shape.distance(&corner).value > radius {
            continue;
        }
        for j in rows {
            for (i, height) in columns.clone().zip(&mut heights[row(j)]) {
                if let Some(gap) = shape.ray_gap(&place(i, j, *height), &up) {
                    *height += gap.min(0.0);
                }
            }
        }
    }
}

/// Distance from a place up to an object (m), negative inside; `None` if nothing is above.
pub(super) fn gap(shape: &Shape, pose: &Isometry3<f64>, place: &Point3<f64>) -> Option<f64> {
    let up = pose.inverse_transform_vector(&Vector3::z());
    shape.ray_gap(&pose.inverse_transform_point(place), &up)
}

#[cfg(test)]
mod tests {
    use std::{
        f64::consts::{FRAC_PI_2, PI},
        sync::Arc,
    };

    use super::*;
    use crate::geometry::{Bump, Hollow, StarShaped, Wave};

    /// Solids that faces are lowered to, each with the solid as rays see it, and by how much what
    /// they are lowered to may be off its surface (m).
    fn solids() -> Vec<(Shape, Shape, f64)> {
        let wave = Wave { amplitude: 0.03, vector: Vector3::new(3.0, 2.0, 1.0), phase: 0.3 };
        let dimple = Bump { amplitude: -0.1, axis: -Vector3::z_axis(), concentration: 12.0 };
        let potato = StarShaped::new(Vector3::new(0.02, 0.02, 0.025), vec![wave]);
        let potato = potato.with_bumps(vec![dimple]);
        // (0.4 mm)²/6R, with R from 5 mm.
        let smooth = 5e-6;
        let shell = Shape::Hollow(Hollow::new(potato.clone(), 0.97));
        let potato = Shape::StarShaped(potato);
        let cuboid = Shape::Cuboid { half_extents: Vector3::new(0.008, 0.011, 0.009) };
        let prism = Shape::Prism { sides: 6, radius: 0.01, half_height: 0.015 };
        let cup = Shape::Cup { bottom: 0.01, rim: 0.012, half_height: 0.01, wall: 5e-4 };
        let mesh = Shape::Mesh(Arc::new(cup.surface(24).unwrap()));
        let half_height = 0.01;
        let round = [
            Shape::Sphere { radius: 0.006 },
            Shape::Ellipsoid { semi_axes: Vector3::new(0.006, 0.009, 0.02) },
            Shape::Cylinder { radius: 0.007, half_height },
            Shape::Cone { radius: 0.015, half_height },
            Shape::Annulus { outer: 0.01, inner: 0.008, half_height },
            Shape::Cup { bottom: 0.012, rim: 0.01, half_height, wall: 1e-3 },
            Shape::Capsule { radius: 0.006, half_height },
            cup.clone(),
        ];
        let mut solids: Vec<_> = round.map(|solid| (solid.clone(), solid, 1e-12)).into();
        let ellipsoid = Shape::Ellipsoid { semi_axes: Vector3::new(0.006, 0.009, 0.02) };
        solids.extend([
            (ellipsoid.sampled().scaled(1.2), ellipsoid.scaled(1.2), 1e-12),
            (cuboid.clone(), cuboid, 1e-9),
            (prism.clone(), prism, 1e-9),
            (mesh.sampled().scaled(1.3), mesh.scaled(1.3), 1e-9),
            (mesh.clone(), mesh, 1e-9),
            (potato.sampled().scaled(1.2), potato.scaled(1.2), smooth),
            (potato.clone(), potato, smooth),
            (shell.clone(), shell, smooth),
        ]);
        solids
    }

    #[test]
    fn a_face_is_lowered_as_by_rays() {
        let grid = PlanGrid { counts: [60, 80], cell: [2.5e-4; 2] };
        let face = |[x, y]: [f64; 2]| 3e-4 * ((1e3 * x).sin() + (700.0 * y).cos());
        let before: Vec<f64> = grid.centres().map(face).collect();
        for (found, exact, tolerance) in solids() {
            let mut lowered = 0;
            let upright = [Vector3::zeros(), PI * Vector3::x(), FRAC_PI_2 * Vector3::y()];
            let any = (0..5)
                .map(f64::from)
                .map(|turn| Vector3::new(0.7 + turn, 1.3 * turn - 2.0, 0.4 * turn * turn));
            for turn in upright.into_iter().chain(any) {
                let turned = Isometry3::rotation(turn);
                let vertices = exact.surface(32).unwrap();
                let heights = vertices.vertices().iter().map(|v| (turned * v).z);
                let low = heights.fold(f64::INFINITY, f64::min);
                // 1.5 mm deep, so that rays pass thin walls, too.
                let aside = Vector3::new(1e-3, -2e-3, -low - 1.5e-3);
                let pose = Isometry3::from_parts(aside.into(), turned.rotation);
                let off = |[x, y]: [f64; 2], z: f64| {
                    exact.distance(&pose.inverse_transform_point(&Point3::new(x, y, z))).value
                };
                let mut after = before.clone();
                lower(&mut after, &grid, &found, &pose);
                for ((place, was), now) in grid.centres().zip(&before).zip(&after) {
                    let depth = off(place, *was);
                    let ray = if depth < 0.0 {
                        gap(&exact, &pose, &Point3::new(place[0], place[1], *was)).unwrap_or(0.0)
                    } else {
                        0.0
                    };
                    let case = format!("{exact:?}, turn {turn:?}, {place:?}: {was} to {now} m");
                    // Where the surface is steep, heights differ by more than the distance to it.
                    let agree = (now - was - ray.min(0.0)).abs() < 50.0 * tolerance;
                    assert!(agree || depth.abs() < tolerance, "{case}, by a ray {ray} m");
                    lowered += usize::from(now < was);
                    assert!(now == was || off(place, *now).abs() < tolerance, "{case}: off");
                }
            }
            assert!(lowered > 500, "{exact:?}: {lowered} pixels are lowered");
        }
    }
}
