//! Tactile channels: a table of their shapes, units and bounds, and the evaluation of each.
//!
//! Vectors are in the frame of the pad. Without contact every entry is exactly 0, except in the
//! depth map and the image, which show the resting face. Bounds: displacement up to four times the
//! pad's thickness, and stress up to 25 times Young's modulus, about ten times the stress that
//! tears a silicone gel; that of single tetrahedra up to a thousand times.

use std::cell::OnceCell;

use nalgebra::Vector3;

use super::{config::Resolution, imprint::RaisedFace, skin::Skin, traction};
use crate::{
    deformation::{Deformation, PredictedError},
    geometry::Shape,
};

/// Quantity that a tactile finger reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    /// Displacement of the markers.
    Markers,
    /// Displacement of the markers in the camera's view, in pixels of the image.
    MarkerPixels,
    /// Displacement of all free surface nodes.
    Displacement,
    /// Von Mises stress on a grid under the face.
    Stress,
    /// Von Mises stress in every tetrahedron.
    TetStress,
    /// Contact traction on a grid over the face.
    Traction,
    /// Net force and torque of the contact.
    Wrench,
    /// Share of the contact that slides.
    Slip,
    /// Height of the face over the camera's view.
    Depth,
    /// Colours of the face in the camera's view.
    Image,
    /// Relative errors that the model predicts of its own solution.
    PredictedError,
}

/// Group of entries of a channel with the same unit and bounds.
#[derive(Clone, Debug, PartialEq)]
pub struct Spec {
    /// Name of the quantity.
    pub name: &'static str,
    /// Shape of the array, the last axis fastest.
    pub shape: Vec<usize>,
    /// Lower bound of each entry.
    pub low: f64,
    /// Upper bound of each entry.
    pub high: f64,
    /// SI unit, or pixel.
    pub unit: &'static str,
}

/// Bound of the displacement, in pad thicknesses. An edge of an object that catches the gel drags
/// it by more than one thickness; with a bound of one, clumsy grasps would end their episodes.
const MOST_MOTION: f64 = 4.0;
/// Bound of the stress, in Young's moduli.
const MOST_STRESS: f64 = 25.0;
/// Bound of the stress of single tetrahedra, in Young's moduli: one that an edge folds has many
/// times the mean over a cell of the grid.
const MOST_TET_STRESS: f64 = 1000.0;
/// Bound of force (N) and torque (N m).
const MOST_FORCE: f64 = 5000.0;

impl Channel {
    /// All channels, in the order of the table.
    pub const ALL: [Self; 11] = [
        Self::Markers,
        Self::MarkerPixels,
        Self::Displacement,
        Self::Stress,
        Self::TetStress,
        Self::Traction,
        Self::Wrench,
        Self::Slip,
        Self::Depth,
        Self::Image,
        Self::PredictedError,
    ];

    /// Name in the settings.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Markers => "markers",
            Self::MarkerPixels => "marker_pixels",
            Self::Displacement => "displacement",
            Self::Stress => "stress",
            Self::TetStress => "tet_stress",
            Self::Traction => "traction",
            Self::Wrench => "wrench",
            Self::Slip => "slip",
            Self::Depth => "depth",
            Self::Image => "image",
            Self::PredictedError => "predicted_error",
        }
    }

    /// Content, as a phrase.
    pub const fn doc(self) -> &'static str {
        match self {
            Self::Markers => "displacement of the sensor's markers (m)",
            Self::MarkerPixels => "the same across and along ``image`` (pixels of ``image``)",
            Self::Displacement => "displacement of all free nodes of the pad's surface (m)",
            Self::Stress => "von Mises stress under the face (Pa)",
            Self::TetStress => "von Mises stress in each tetrahedron (Pa)",
            Self::Traction => "contact force per area (Pa): shear in x and y, normal in z",
            Self::Wrench => "force (N) and torque about the apex (N m)",
            Self::Slip => "share of the normal force carried where the pad slides",
            Self::Depth => "height of the face over the camera's view (m)",
            Self::Image => "red, green and blue that the sensor's camera sees (0 to 1)",
            Self::PredictedError => {
                "relative errors of displacement, stress and force that 19 of 20 stay below"
            }
        }
    }

    /// Size for one finger at the default resolution, in words: the pad has T tetrahedra, its
    /// surface S free nodes.
    pub fn default_size(self) -> String {
        let Resolution { markers, grid, depth, image, .. } = Resolution::default();
        let map = |[across, along]: [u32; 2]| format!("{along} x {across}");
        match self {
            Self::Markers => map(markers) + " x 3",
            Self::MarkerPixels => map(markers) + " x 2",
            Self::Displacement => "S x 3".to_owned(),
            Self::Stress => map(grid),
            Self::TetStress => "T".to_owned(),
            Self::Traction => map(grid) + " x 3",
            Self::Wrench => "6".to_owned(),
            Self::Slip => "1".to_owned(),
            Self::Depth => map(depth),
            Self::Image => map(image) + " x 3",
            Self::PredictedError => "3".to_owned(),
        }
    }

    /// Returns the channel called `name`.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|channel| channel.name() == name)
    }

    /// Number of entries of a point: 3 where it has a vector or a colour, 2 in the camera's view,
    /// otherwise 1.
    pub const fn point(self) -> usize {
        match self {
            Self::Markers | Self::Displacement | Self::Traction | Self::Image => 3,
            Self::MarkerPixels => 2,
            Self::Stress
            | Self::TetStress
            | Self::Wrench
            | Self::Slip
            | Self::Depth
            | Self::PredictedError => 1,
        }
    }

    /// Quantities of a channel that has several, in the order of its entries for one finger, and
    /// the number of entries of each.
    pub const fn quantities(self) -> &'static [(&'static str, usize)] {
        match self {
            Self::Wrench => &[("force", 3), ("torque", 3)],
            Self::PredictedError => &[("displacement", 1), ("stress", 1), ("force", 1)],
            Self::Markers
            | Self::MarkerPixels
            | Self::Displacement
            | Self::Stress
            | Self::TetStress
            | Self::Traction
            | Self::Slip
            | Self::Depth
            | Self::Image => &[],
        }
    }

    /// Returns whether this channel needs the stress, an optional part of a solution.
    pub const fn is_of_stress(self) -> bool {
        match self {
            Self::Stress | Self::TetStress => true,
            Self::Markers
            | Self::MarkerPixels
            | Self::Displacement
            | Self::Traction
            | Self::Wrench
            | Self::Slip
            | Self::Depth
            | Self::Image
            | Self::PredictedError => false,
        }
    }

    /// Components of this channel for one finger.
    pub fn specs(self, skin: &Skin) -> Vec<Spec> {
        let map = |counts: [u32; 2]| vec![counts[1] as usize, counts[0] as usize];
        let vectors = |counts: [u32; 2]| [map(counts), vec![3]].concat();
        let (thickness, stress) = (skin.face.thickness(), MOST_STRESS * skin.moduli.young);
        let moved = MOST_MOTION * thickness;
        let spec = |name, shape, low, high, unit| Spec { name, shape, low, high, unit };
        let resolution = &skin.resolution;
        match self {
            Self::Markers => {
                let shape = vectors(resolution.markers);
                vec![spec("displacement of the markers", shape, -moved, moved, "m")]
            }
            Self::MarkerPixels => {
                let shape = [map(resolution.markers), vec![2]].concat();
                let [across, along] = skin.picture.cell;
                let most = moved / across.min(along);
                vec![spec("displacement of the markers in the image", shape, -most, most, "pixel")]
            }
            Self::Displacement => {
                let shape = vec![skin.free.len(), 3];
                vec![spec("displacement of the surface nodes", shape, -moved, moved, "m")]
            }
            Self::Stress => {
                vec![spec(
                    "von Mises stress under the face",
                    map(resolution.grid),
                    0.0,
                    stress,
                    "Pa",
                )]
            }
            Self::TetStress => {
                let most = MOST_TET_STRESS * skin.moduli.young;
                vec![spec("von Mises stress of the tetrahedra", vec![skin.tets], 0.0, most, "Pa")]
            }
            Self::Traction => {
                vec![spec("traction", vectors(resolution.grid), -stress, stress, "Pa")]
            }
            Self::Wrench => vec![
                spec("force", vec![3], -MOST_FORCE, MOST_FORCE, "N"),
                spec("torque about the apex", vec![3], -MOST_FORCE, MOST_FORCE, "N m"),
            ],
            Self::Slip => {
                vec![spec("share of the normal force where the pad slides", vec![1], 0.0, 1.0, "")]
            }
            Self::Depth => {
                let shape = map(resolution.depth);
                vec![spec("height over the resting apex", shape, -thickness, thickness, "m")]
            }
            Self::Image => {
                vec![spec(
                    "red, green and blue of the tactile image",
                    vectors(resolution.image),
                    0.0,
                    1.0,
                    "",
                )]
            }
            Self::PredictedError => vec![
                spec("predicted error of the displacement", vec![1], 0.0, PredictedError::MOST, ""),
                spec("predicted error of the stress", vec![1], 0.0, PredictedError::MOST, ""),
                spec("predicted error of the force", vec![1], 0.0, PredictedError::MOST, ""),
            ],
        }
    }

    /// Number of entries for one finger.
    pub fn size(self, skin: &Skin) -> usize {
        self.specs(skin).iter().map(|spec| spec.shape.iter().product::<usize>()).sum()
    }

    /// Entries for one finger that touches `shapes`, those of the `answer`, which is `None` without
    /// contact. Only [`Channel::Depth`] and [`Channel::Image`] need the shapes; without them, both
    /// show the mesh alone.
    ///
    /// # Panics
    ///
    /// For [`Channel::Image`] if [`Skin::has_image`] is false.
    pub fn read(self, skin: &Skin, answer: Option<&Deformation>, shapes: &[&Shape]) -> Vec<f64> {
        self.read_with(skin, answer, shapes, &OnceCell::new())
    }

    /// Entries as [`Channel::read`] returns them. `raised` is of this answer, empty at first; other
    /// channels of the same answer read it.
    pub(crate) fn read_with(
        self,
        skin: &Skin,
        answer: Option<&Deformation>,
        shapes: &[&Shape],
        raised: &OnceCell<RaisedFace>,
    ) -> Vec<f64> {
        match (self, answer) {
            (Self::Image, _) => {
                let camera = skin.camera.as_ref().expect("only sensors with colours have images");
                camera.picture(&skin.face, answer, shapes, raised)
            }
            (Self::Depth, None) => skin.rest_depth.clone(),
            (_, None) => vec![0.0; self.size(skin)],
            (Self::Markers, Some(answer)) => flat(&markers(skin, answer)),
            (Self::MarkerPixels, Some(answer)) => {
                let [across, along] = skin.picture.cell;
                let seen = |u: Vector3<f64>| [u.x / across, u.y / along];
                markers(skin, answer).into_iter().flat_map(seen).collect()
            }
            (Self::Displacement, Some(answer)) => {
                flat(skin.free.iter().map(|&node| &answer.displacement[node as usize]))
            }
            (Self::Stress, Some(answer)) => stress(skin, answer),
            (Self::TetStress, Some(answer)) => answer.von_mises.clone(),
            (Self::Traction, Some(answer)) => flat(&traction::map(skin, answer)),
            (Self::Wrench, Some(answer)) => flat([&answer.wrench.force, &answer.wrench.torque]),
            (Self::Slip, Some(answer)) => vec![answer.sliding],
            (Self::Depth, Some(answer)) => {
                let objects: Vec<_> = shapes.iter().copied().zip(&answer.poses).collect();
                skin.view.imprint(&skin.face, answer, &objects, raised).heights
            }
            (Self::PredictedError, Some(answer)) => {
                let PredictedError { displacement, stress, force } =
                    answer.predicted_error.unwrap_or_default();
                vec![displacement, stress, force]
            }
        }
    }
}

fn flat<'a>(vectors: impl IntoIterator<Item = &'a Vector3<f64>>) -> Vec<f64> {
    vectors.into_iter().flat_map(|v| v.iter().copied()).collect()
}

fn markers(skin: &Skin, deformation: &Deformation) -> Vec<Vector3<f64>> {
    let moved = |(corners, shares): &([u32; 3], [f64; 3])| {
        (0..3).map(|i| deformation.displacement[corners[i] as usize] * shares[i]).sum()
    };
    skin.markers.iter().map(moved).collect()
}

fn stress(skin: &Skin, deformation: &Deformation) -> Vec<f64> {
    let at = |shares: &Vec<(u32, f64)>| {
        shares.iter().map(|&(tet, share)| deformation.von_mises[tet as usize] * share).sum()
    };
    skin.stress.iter().map(at).collect()
}
