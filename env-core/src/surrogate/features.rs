//! Input and target of the network for a press, as dimensionless numbers.
//!
//! Lengths are in units of the pad's thickness L, stresses of the shear modulus μ, forces of E L².
//! Young's modulus drops out: displacements do not depend on it and stresses are proportional to
//! it. The network's outputs are multiplied by the amplitude of the press, those for forces by its
//! largest nodal force, so without contact they are exactly zero.
//!
//! Shapes: C columns, V nodes, T tetrahedra.

use candle_core::Tensor;
use nalgebra::{Point3, Vector3};

use super::{
    graph::{LAYERS, Mirror, PLACE_FEATURES, PadGraph},
    linear::{CellContact, LinearFields, PadFields},
    material::PadMaterial,
};
use crate::{
    compliance::nodal::NodeContact,
    geometry::{Distance, Shape},
};

/// Number of features of a column: displacement of its layers, contact force, distance from the
/// undisplaced column to the object, distance from the displaced column in units of the amplitude
/// and of the thickness, normal of the object, position of the column, features of the press as a
/// whole, and of its contact on cells, slope of the displaced face, fidelity.
pub(super) const FEATURES: usize = FIDELITY + 1;
/// Number of features before those of contact on cells.
const CELLS: usize = 3 * LAYERS + 3 + 3 + 3 + PLACE_FEATURES + GLOBALS;
/// Number of features of the press as a whole: amplitude, compressibility, friction, force over
/// amplitude.
const GLOBALS: usize = 4;
/// Number of features of a column's contact on cells: touched area, pressure over Young's modulus,
/// slope of the object against the face, spread of its normals, its mean normal.
const COLUMN_CELLS: usize = 7;
/// Number of features of all contact on cells: the means of pressure, slope and spread, size of a
/// cell, number of cells.
const PRESS_CELLS: usize = 5;
/// Number of features before the slope of the displaced face: along x and y, its norm, and its
/// product with the object's normal.
const SLOPES: usize = CELLS + COLUMN_CELLS + PRESS_CELLS;
/// Number of features before the fidelity: 0 for a press of which the solution to learn from is the
/// less accurate one of two kinds, else 1.
const FIDELITY: usize = SLOPES + 4;
/// Number of vectors of a column along which its displacement is corrected.
pub(super) const DIRECTIONS: usize = 3;

/// A press with its linear solution.
#[derive(Clone, Debug)]
pub(super) struct PadInput {
    /// Features of the columns (C, [`FEATURES`]).
    pub(super) features: Vec<f32>,
    /// Displacement of the linear solution (V, 3).
    pub(super) displacement: Vec<f32>,
    /// Its von Mises stress (T).
    pub(super) stress: Vec<f32>,
    /// Its contact forces on the face (C, 3).
    pub(super) forces: Vec<f32>,
    /// Its contact force on all other nodes.
    pub(super) other_force: [f32; 3],
    /// Factor on the correction of the contact force (C): 1 where the object touches, falling to 0
    /// where it is far.
    pub(super) gates: Vec<f32>,
    /// Normals of the object at the displaced columns (C, 3).
    pub(super) normals: Vec<f32>,
    /// Vectors along which the displacement of a column is corrected (C, [`DIRECTIONS`], 3): the
    /// normal times the amplitude, the normal times the distance to the object, at most the
    /// amplitude, and u_z ∇u_z of the face: to second order, the sideways displacement of a face
    /// that is dragged along by its slope.
    pub(super) directions: Vec<f32>,
    /// Largest displacement of a node.
    pub(super) amplitude: f32,
    /// Largest contact force on a node.
    pub(super) strongest: f32,
}

/// Finite-element solution of a press.
#[derive(Clone, Debug)]
pub(super) struct Target {
    /// Displacement (V, 3).
    pub(super) displacement: Vec<f32>,
    /// Von Mises stress (T).
    pub(super) stress: Vec<f32>,
    /// Contact forces on the face (C, 3).
    pub(super) forces: Vec<f32>,
    /// Net contact force.
    pub(super) force: [f32; 3],
}

/// Fields of an answer in the units of [`Target`]; NaN where the model does not output a field.
pub(super) struct Fields {
    pub(super) displacement: Vec<f32>,
    pub(super) stress: Vec<f32>,
    pub(super) forces: Vec<f32>,
    pub(super) force: [f32; 3],
}

impl Fields {
    /// Converts a network's output for one press: displacement, stress, nodal forces and net force.
    pub(super) fn of(
        [displacement, stress, forces, force]: [&Tensor; 4],
    ) -> candle_core::Result<Self> {
        let flat = |x: &Tensor| x.flatten_all()?.to_vec1();
        let (displacement, stress, forces, force) =
            (flat(displacement)?, flat(stress)?, flat(forces)?, flat(force)?);
        Ok(Self { displacement, stress, forces, force: [force[0], force[1], force[2]] })
    }

    /// The linear solution in `input`.
    pub(super) fn linear(input: &PadInput) -> Self {
        let PadInput { displacement, stress, forces, .. } = input.clone();
        Self { displacement, stress, forces, force: input.force() }
    }
}

/// Distance of the object from the displaced face beyond which contact forces are not corrected, in
/// units of L.
const REACH: f64 = 0.125;

impl PadInput {
    /// Returns the network's input for `linear`, the linear solution to a press of `shapes`.
    pub(super) fn new(
        graph: &PadGraph,
        gel: &PadMaterial,
        places: &[Point3<f64>],
        shapes: &[Shape],
        linear: &LinearFields,
    ) -> Self {
        let LinearFields { fields: linear, cells } = linear;
        let (length, columns) = (gel.thickness, graph.columns);
        let amplitude = linear.displacement.iter().map(Vector3::norm).fold(0.0, f64::max);
        let strongest = linear.contact_force.iter().map(Vector3::norm).fold(0.0, f64::max);
        let total: Vector3<f64> = linear.contact_force.iter().sum();
        let other: Vector3<f64> = linear.contact_force[columns..].iter().sum();
        let globals = [
            2.0 * amplitude / length,
            10.0 * (0.5 - gel.moduli.poisson),
            gel.friction,
            (total.norm() * length / (gel.force() * amplitude.max(f64::MIN_POSITIVE))).ln_1p(),
        ]
        .map(|x| x as f32);
        let (of_columns, of_press) = cell_features(cells, gel, columns);
        let margin = 2.0 * shapes.iter().map(Shape::distance_error).fold(0.0, f64::max);
        let mut features = vec![0.0; columns * FEATURES];
        let mut gates = vec![0.0; columns];
        let mut normals = vec![0.0; 3 * columns];
        let mut directions = vec![0.0; 3 * DIRECTIONS * columns];
        let slopes = graph.slopes(|column| linear.displacement[column].z);
        let [by_amplitude, by_strongest] =
            [amplitude, strongest].map(|most| 1.0 / most.max(f64::MIN_POSITIVE));
        for (column, features) in features.as_chunks_mut::<FEATURES>().0.iter_mut().enumerate() {
            let (rest, displacement) = (places[column], linear.displacement[column]);
            let Distance { value: gap, normal } = nearest(shapes, linear, &(rest + displacement));
            // A distance changes by at most the displacement: that of the undisplaced column need
            // not be computed where its feature is 1 in any case.
            let is_far = gap - displacement.norm() >= 0.5 * length + margin;
            let before = if is_far { 0.5 * length } else { nearest(shapes, linear, &rest).value };
            let distances = [
                (2.0 * before / length).clamp(-1.0, 1.0),
                (gap * by_amplitude).clamp(-1.0, 1.0),
                (8.0 * gap / length).clamp(-1.0, 1.0),
            ];
            let slope = Vector3::new(slopes[column][0], slopes[column][1], 0.0);
            let of_column = &of_columns[column];
            let mut rest = &mut features[..];
            let mut put = |numbers: &[f32]| {
                let (here, after) = std::mem::take(&mut rest).split_at_mut(numbers.len());
                here.copy_from_slice(numbers);
                rest = after;
            };
            for layer in 0..LAYERS {
                put(&single(&(linear.displacement[layer * columns + column] * by_amplitude)));
            }
            put(&single(&(linear.contact_force[column] * by_strongest)));
            put(&distances.map(|x| x as f32));
            put(&single(&normal));
            put(&graph.places[column * PLACE_FEATURES..][..PLACE_FEATURES]);
            put(&globals);
            put(of_column);
            put(&of_press);
            let numbers = [slope.x, slope.y, slope.norm(), slope.dot(&normal)];
            put(&numbers.map(|x| (4.0 * x) as f32));
            put(&[1.0]);
            let near = distances[1] * amplitude * normal;
            let dragged = displacement.z * slope;
            normals[3 * column..][..3].copy_from_slice(&single(&normal));
            let of_column = directions[3 * DIRECTIONS * column..].as_chunks_mut().0.iter_mut();
            for (to, direction) in of_column.zip([amplitude * normal, near, dragged]) {
                *to = single(&(direction / length));
            }
            let gate = (1.0 - gap / (REACH * length)).clamp(0.0, 1.0) as f32;
            gates[column] = if features[CELLS] > 0.0 { 1.0 } else { gate };
        }
        Self {
            features,
            displacement: flat(&linear.displacement, length),
            stress: linear.von_mises.iter().map(|s| (s / gel.moduli.shear()) as f32).collect(),
            forces: flat(&linear.contact_force[..columns], gel.force()),
            other_force: (other / gel.force()).map(|x| x as f32).into(),
            gates,
            normals,
            directions,
            amplitude: (amplitude / length) as f32,
            strongest: (strongest / gel.force()) as f32,
        }
    }

    /// Marks the press as one of which the solution to learn from is the less accurate one.
    pub(super) fn of_low_fidelity(mut self) -> Self {
        self.features.chunks_exact_mut(FEATURES).for_each(|row| row[FIDELITY] = 0.0);
        self
    }

    /// Features of all contact on cells: means of pressure, slope and spread, size and number of
    /// the cells.
    pub(super) fn of_press(&self) -> [f64; PRESS_CELLS] {
        std::array::from_fn(|i| f64::from(self.features[CELLS + COLUMN_CELLS + i]))
    }

    /// Net contact force of the linear solution.
    pub(super) fn force(&self) -> [f32; 3] {
        self.forces
            .as_chunks::<3>()
            .0
            .iter()
            .fold(self.other_force, |sum, force| std::array::from_fn(|i| sum[i] + force[i]))
    }

    /// Coefficient of friction.
    pub(super) fn friction(&self) -> f64 {
        f64::from(self.features[CELLS - 2])
    }

    /// Returns the same press seen in a mirror.
    pub(super) fn mirrored(&self, mirror: &Mirror) -> Self {
        let Self { other_force, amplitude, strongest, .. } = *self;
        let signs = feature_signs(mirror.signs);
        let thrice: [f32; 3 * DIRECTIONS] = std::array::from_fn(|i| mirror.signs[i % 3]);
        Self {
            features: moved(&self.features, &mirror.columns, &signs),
            displacement: moved(&self.displacement, &mirror.columns, &mirror.signs),
            stress: moved(&self.stress, &mirror.tets, &[1.0]),
            forces: moved(&self.forces, &mirror.columns, &mirror.signs),
            other_force: std::array::from_fn(|i| other_force[i] * mirror.signs[i]),
            gates: moved(&self.gates, &mirror.columns, &[1.0]),
            normals: moved(&self.normals, &mirror.columns, &mirror.signs),
            directions: moved(&self.directions, &mirror.columns, &thrice),
            amplitude,
            strongest,
        }
    }
}

impl Target {
    /// Returns the same solution seen in a mirror.
    pub(super) fn mirrored(&self, mirror: &Mirror) -> Self {
        Self {
            displacement: moved(&self.displacement, &mirror.columns, &mirror.signs),
            stress: moved(&self.stress, &mirror.tets, &[1.0]),
            forces: moved(&self.forces, &mirror.columns, &mirror.signs),
            force: std::array::from_fn(|i| self.force[i] * mirror.signs[i]),
        }
    }
}

/// Features of the contact of each column on cells, and of all of it.
fn cell_features(
    cells: &CellContact,
    gel: &PadMaterial,
    columns: usize,
) -> (Vec<[f32; COLUMN_CELLS]>, [f32; PRESS_CELLS]) {
    let (young, length) = (gel.moduli.young, gel.thickness);
    let mut of_columns = vec![[0.0; COLUMN_CELLS]; columns];
    let (mut all, mut area) = (NodeContact::default(), 0.0);
    let mut pressures = 0.0;
    let means = |c: &NodeContact| {
        let unit = c.borne.max(f64::MIN_POSITIVE);
        let normal = c.normal / unit;
        [(c.slope / unit).ln_1p(), 1.0 - normal.norm(), normal.x, normal.y, normal.z]
    };
    for (node, contact) in &cells.nodes {
        let pressure = contact.borne / (young * contact.area.max(f64::MIN_POSITIVE));
        let [slope, spread, x, y, z] = means(contact);
        let touched = 8.0 * contact.area / (length * length);
        let own = [touched, (4.0 * pressure).ln_1p(), slope, 4.0 * spread, x, y, z];
        of_columns[*node as usize] = own.map(|x| x as f32);
        all.borne += contact.borne;
        all.normal += contact.normal;
        all.slope += contact.slope;
        area += contact.area;
        pressures += pressure * contact.borne;
    }
    let pressure = pressures / all.borne.max(f64::MIN_POSITIVE);
    let [slope, spread, ..] = means(&all);
    let count = area / (cells.spacing * cells.spacing);
    let size = (cells.spacing / length).ln() + 2.5;
    let of_press =
        [(4.0 * pressure).ln_1p(), slope, 4.0 * spread, 0.5 * size, 0.25 * count.ln_1p()];
    (of_columns, of_press.map(|x| x as f32))
}

/// Sign of each feature in a mirror of the given `signs`.
fn feature_signs([x, y, z]: [f32; 3]) -> [f32; FEATURES] {
    let mut all = [1.0; FEATURES];
    let distances = 3 * (LAYERS + 1);
    for vector in (0..=LAYERS).map(|k| 3 * k).chain([distances + 3]) {
        all[vector..vector + 3].copy_from_slice(&[x, y, z]);
    }
    let place = distances + 6;
    all[place..place + 2].copy_from_slice(&[x, y]);
    all[CELLS + 4..CELLS + 7].copy_from_slice(&[x, y, z]);
    all[SLOPES..SLOPES + 2].copy_from_slice(&[x, y]);
    all
}

/// Returns the rows of a field, each taken from its image in the mirror; a field of several layers
/// of columns is mirrored layer by layer. A mirror is its own inverse.
fn moved(field: &[f32], images: &[u32], signs: &[f32]) -> Vec<f32> {
    let (width, layer) = (signs.len(), signs.len() * images.len());
    let rows = field.chunks_exact(layer).flat_map(|layer| {
        images.iter().map(move |&image| &layer[width * image as usize..][..width])
    });
    rows.flat_map(|row| row.iter().zip(signs).map(|(x, sign)| x * sign)).collect()
}

fn single(vector: &Vector3<f64>) -> [f32; 3] {
    vector.cast::<f32>().into()
}

/// Vectors in units of `unit`.
pub(super) fn flat(vectors: &[Vector3<f64>], unit: f64) -> Vec<f32> {
    let mut all = vec![0.0; 3 * vectors.len()];
    for (to, vector) in all.as_chunks_mut().0.iter_mut().zip(vectors) {
        *to = single(&(vector / unit));
    }
    all
}

/// Distance to the nearest shape, with its normal in the pad's frame.
fn nearest(shapes: &[Shape], linear: &PadFields, place: &Point3<f64>) -> Distance {
    let far = Distance { value: f64::INFINITY, normal: Vector3::z() };
    shapes.iter().zip(&linear.poses).fold(far, |nearest, (shape, pose)| {
        let found = shape.distance(&pose.inverse_transform_point(place));
        if found.value < nearest.value {
            Distance { value: found.value, normal: pose * found.normal }
        } else {
            nearest
        }
    })
}

#[cfg(test)]
mod tests {
    use std::slice;

    use nalgebra::Isometry3;

    use super::*;
    use crate::{
        deformation::Moduli,
        geometry::{StarShaped, Wave},
        sensor::Sensor,
    };

    /// Place of the distance from the undisplaced column among its features.
    const BEFORE: usize = 3 * LAYERS + 3;

    /// Graph, nodes and material of a GelSight Mini's pad.
    fn mini() -> (PadGraph, Vec<Point3<f64>>, PadMaterial) {
        let sensor = Sensor::named("gelsight-mini").unwrap();
        let pad = sensor.pad(1000).unwrap();
        let moduli = Moduli { young: 3e5, poisson: 0.47 };
        let gel = PadMaterial { moduli, friction: 0.5, thickness: sensor.outline.thickness };
        (PadGraph::new(&pad).unwrap(), pad.mesh.vertices, gel)
    }

    /// A displacement of up to a millimetre without contact, with a shape at `pose`.
    fn displaced(nodes: usize, pose: Isometry3<f64>) -> LinearFields {
        let direction = |i: f64| Vector3::new(i.sin(), (2.0 * i).cos(), (3.0 * i).sin());
        let displacement = (0..nodes).map(|i| 6e-4 * direction(i as f64)).collect();
        let contact_force = vec![Vector3::zeros(); nodes];
        let fields =
            PadFields { displacement, contact_force, von_mises: Vec::new(), poses: vec![pose] };
        LinearFields { fields, cells: CellContact { nodes: Vec::new(), spacing: 1e-3 } }
    }

    #[test]
    fn a_press_of_low_fidelity_differs_in_one_feature() {
        let (graph, places, gel) = mini();
        let linear = displaced(places.len(), Isometry3::translation(0.0, 0.0, 4e-3));
        let shapes = [Shape::Sphere { radius: 4e-3 }];
        let fine = PadInput::new(&graph, &gel, &places, &shapes, &linear);
        let low = fine.clone().of_low_fidelity();
        for (a, b) in fine.features.chunks(FEATURES).zip(low.features.chunks(FEATURES)) {
            assert_eq!((a[FIDELITY], b[FIDELITY]), (1.0, 0.0));
            assert_eq!(a[..FIDELITY], b[..FIDELITY]);
        }
        for mirror in &graph.mirrors {
            let row = &low.mirrored(mirror).features[..FEATURES];
            assert_eq!(row[FIDELITY], 0.0);
        }
    }

    #[test]
    fn distances_of_far_columns_are_those_of_a_query_to_the_bit() {
        let (graph, places, gel) = mini();
        let semi_axes = Vector3::new(4e-3, 5e-3, 8e-3);
        let wave = Wave { amplitude: 0.03, vector: Vector3::new(3.0, 2.0, 1.0), phase: 0.3 };
        let shapes = [
            Shape::Sphere { radius: 4e-3 },
            Shape::Cuboid { half_extents: semi_axes },
            Shape::Ellipsoid { semi_axes }.sampled().scaled(1.2),
            Shape::StarShaped(StarShaped::new(semi_axes, vec![wave])).sampled(),
        ];
        let heights = [3e-3, 6e-3, 1e-2, 1.5e-2, 2.5e-2];
        for (shape, height) in shapes.iter().flat_map(|shape| heights.map(|h| (shape, h))) {
            let turned = Vector3::new(0.3, 0.2, 0.1);
            let pose = Isometry3::new(Vector3::new(5e-3, -4e-3, height), turned);
            let linear = displaced(places.len(), pose);
            let found = PadInput::new(&graph, &gel, &places, slice::from_ref(shape), &linear);
            for (row, place) in found.features.chunks_exact(FEATURES).zip(&places) {
                let before = nearest(slice::from_ref(shape), &linear.fields, place).value;
                let exact = (2.0 * before / gel.thickness).clamp(-1.0, 1.0) as f32;
                assert_eq!(row[BEFORE].to_bits(), exact.to_bits(), "{shape:?} at {height} m");
            }
        }
    }
}
