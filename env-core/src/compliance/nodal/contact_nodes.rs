//! Contact nodes of a body, with the compliance between them.
//!
//! They are the body's own skin nodes, or the face nodes of a coarser mesh of the same pad. In the
//! latter case a force is spread over the fine nodes as a traction that falls off linearly to the
//! neighbours, and displacement is interpolated, so that the elasticity remains that of the fine
//! mesh.
//!
//! Shapes: M contact nodes, N skin nodes of the body.

use std::sync::Arc;

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

use super::{
    super::condensed::Condensed,
    between::{ContactTriangle, widest},
    grid::CellGrid,
};
use crate::{
    Error, Result,
    contact::{PointGroup, SurfacePoint, is_engulfed, is_within},
    deformation::{ModelIdentity, Numbering},
    geometry::{PadMesh, Shape, vertex_normals},
    responses::Responses,
};

/// Contact nodes of a body, with the data that all its presses share.
pub(super) struct ContactNodes {
    pub(super) condensed: Arc<Condensed>,
    pub(super) compliance: NodeCompliance,
    /// Displacement of each node under unit forces on itself (M) in m/N; empty if it is computed.
    own: Vec<Matrix3<f64>>,
    pub(super) places: Vec<Point3<f64>>,
    /// Outward unit normals at rest (M), zero where there is none.
    normals: Vec<Vector3<f64>>,
    /// Skin nodes of the body that bear a force on each contact node (M).
    pub(super) loads: Vec<Shares>,
    /// Each node as a surface point (M).
    pub(super) points: Vec<SurfacePoint>,
    /// Nodes that represent some area, by rank.
    pub(super) groups: Vec<PointGroup>,
    /// Triangles of contact nodes, the widest first.
    pub(super) faces: Vec<ContactTriangle>,
}

/// Displacement of contact nodes under unit forces on each other (m/N).
pub(super) enum NodeCompliance {
    /// Kept in memory: of all nodes under unit forces on each (3M, 3M), with the grid, if its cells
    /// are the nodes.
    Stored(Responses, Option<CellGrid>),
    /// Computed where it is needed: between the cells of a grid, which are the nodes.
    Computed(CellGrid),
}

/// Skin nodes of a body, by rank, with weights that sum to 1.
pub(super) type Shares = Vec<(u32, f64)>;

impl ContactNodes {
    /// Takes the skin nodes of the body as contact nodes.
    pub(super) fn new(condensed: Arc<Condensed>) -> Self {
        let place = |&node: &u32| condensed.rest.places()[node as usize];
        let places: Vec<_> = condensed.skin.iter().map(place).collect();
        let size = 3 * places.len();
        let mut compliance = Responses::new(size);
        let rows = condensed.compliance().chunks_exact(size);
        rows.for_each(|row| compliance.push(row.iter().copied()));
        let loads = (0..places.len() as u32).map(|rank| vec![(rank, 1.0)]).collect();
        let areas = condensed.areas();
        let rank = |node: u32| condensed.rank_of(node).map(|rank| rank as u32);
        let ranks = |[a, b, c]: [u32; 3]| Some([rank(a)?, rank(b)?, rank(c)?]);
        let faces = condensed.body.mesh().boundary().into_iter().filter_map(ranks).collect();
        Self::of(condensed, compliance, places, loads, &areas, faces)
    }

    /// Takes the face nodes of a `coarse` mesh of a pad as contact nodes; `fine` is the mesh of the
    /// `condensed` pad. Returns an error if the faces do not cover each other.
    pub(super) fn coarse(
        condensed: Arc<Condensed>,
        fine: &PadMesh,
        coarse: &PadMesh,
    ) -> Result<Self> {
        let (loads, borne) = tents(&condensed, fine, coarse)?;
        let rank = |node: u32| condensed.rank_of(node).map(|rank| rank as u32);
        let places: Vec<_> =
            coarse.face.iter().map(|&node| coarse.mesh.vertices[node as usize]).collect();
        let sight = |place: &Point3<f64>| -> Result<Shares> {
            let (corners, shares) = fine.under(place.x, place.y).ok_or_else(|| off(place))?;
            let ranks = corners.map(rank).into_iter().zip(shares);
            ranks.map(|(rank, share)| Ok((rank.ok_or_else(|| off(place))?, share))).collect()
        };
        let sights = places.iter().map(sight).collect::<Result<Vec<_>>>()?;
        let compliance = condensed_between(&condensed, &loads, &sights);
        let faces = coarse.face_triangles.clone();
        Ok(Self::of(condensed, compliance, places, loads, &borne, faces))
    }

    fn of(
        condensed: Arc<Condensed>,
        compliance: Responses,
        places: Vec<Point3<f64>>,
        loads: Vec<Shares>,
        areas: &[f64],
        faces: Vec<[u32; 3]>,
    ) -> Self {
        let young = condensed.body.moduli().iter().map(|moduli| moduli.young).fold(0.0, f64::max);
        let point = |(node, &area): (u32, &f64)| {
            let shares = vec![(node, 1.0)];
            SurfacePoint { shares, area, young }
        };
        let points = (0..).zip(areas).map(point).collect();
        let bearing = (0..).zip(&places).filter(|(rank, _)| areas[*rank as usize] > 0.0);
        let groups = PointGroup::groups(bearing.map(|(rank, place)| (rank, *place)));
        let normals = vertex_normals(&places, &faces);
        let faces =
            widest(faces.into_iter().map(|face| ContactTriangle::new(face, &places)).collect());
        let own = own(&compliance);
        let compliance = NodeCompliance::Stored(compliance, None);
        Self { condensed, compliance, own, places, normals, loads, points, groups, faces }
    }

    /// Takes the cells of a `grid` on the face of a pad as contact nodes. Only those of the first
    /// grid are grouped and their compliance is stored; no faces are watched for shapes between
    /// them.
    pub(super) fn of_grid(condensed: Arc<Condensed>, grid: CellGrid, is_first: bool) -> Self {
        let young = condensed.body.moduli().iter().map(|moduli| moduli.young).fold(0.0, f64::max);
        let point = SurfacePoint { shares: vec![(0, 1.0)], area: grid.area(), young };
        let (mut places, mut points, mut grouped) = (Vec::new(), vec![point.clone()], Vec::new());
        let mut own = Vec::new();
        if is_first {
            places = (0..grid.len() as u32).map(|rank| grid.place(rank)).collect();
            let of_cell = |node| SurfacePoint { shares: vec![(node, 1.0)], ..point.clone() };
            points = (0..places.len() as u32).map(of_cell).collect();
            grouped = PointGroup::groups((0..).zip(places.iter().copied()));
            for group in &mut grouped {
                group.radius += grid.half_diagonal();
            }
        }
        let compliance = if is_first {
            let responses = grid.responses();
            own = self::own(&responses);
            NodeCompliance::Stored(responses, Some(grid))
        } else {
            NodeCompliance::Computed(grid)
        };
        let (loads, faces, normals) = (Vec::new(), Vec::new(), Vec::new());
        Self { condensed, compliance, own, places, normals, loads, points, groups: grouped, faces }
    }

    /// Identity of the model.
    pub(super) fn identity(&self) -> ModelIdentity {
        let is_grid = self.grid().is_some();
        let numbering = if is_grid { Numbering::Cells } else { Numbering::ContactNodes };
        self.condensed.identity.with_numbering(numbering)
    }

    /// Number of contact nodes M.
    pub(super) fn len(&self) -> usize {
        self.grid().map_or(self.places.len(), CellGrid::len)
    }

    /// Position of a node at rest.
    pub(super) fn place(&self, rank: u32) -> Point3<f64> {
        self.grid().map_or_else(|| self.places[rank as usize], |grid| grid.place(rank))
    }

    /// Outward unit normal of a node at rest, zero where there is none.
    pub(super) fn normal(&self, rank: u32) -> Vector3<f64> {
        self.grid().map_or_else(|| self.normals[rank as usize], |grid| grid.normal(rank))
    }

    /// Displacement of a node under unit forces on itself, if it is stored (m/N).
    pub(super) fn own(&self, rank: u32) -> Matrix3<f64> {
        self.own[rank as usize]
    }

    /// The node as a surface point; on a grid, where they differ by their place only, any.
    pub(super) fn point(&self, rank: u32) -> &SurfacePoint {
        if self.grid().is_some() { &self.points[0] } else { &self.points[rank as usize] }
    }

    /// Returns whether `shape` at its `pose` lies wholly inside the body at rest.
    pub(super) fn engulfs(&self, shape: &Shape, pose: &Isometry3<f64>) -> bool {
        if let Some(grid) = self.grid() {
            // Where the mesh is coarse, its faces lie under that of a curved pad.
            return is_within(shape, pose, |point| grid.outline().contains(point));
        }
        let mesh = self.condensed.body.mesh();
        is_engulfed(shape, pose, mesh, &vec![Vector3::zeros(); mesh.vertices.len()])
    }

    /// The grid, if its cells are the nodes.
    pub(super) fn grid(&self) -> Option<&CellGrid> {
        match &self.compliance {
            NodeCompliance::Stored(_, grid) => grid.as_ref(),
            NodeCompliance::Computed(grid) => Some(grid),
        }
    }

    /// Displacement of every contact node (M) in m under `forces` (N) on some of them.
    pub(super) fn displacement(&self, forces: &[(u32, Vector3<f64>)]) -> Vec<Vector3<f64>> {
        match &self.compliance {
            NodeCompliance::Stored(compliance, _) => {
                let mut sum = vec![0.0; compliance.len()];
                for (rank, force) in forces {
                    compliance.add(*rank, force, &mut sum);
                }
                let sum = sum[..compliance.width()].as_chunks::<3>().0;
                sum.iter().map(|&u| Vector3::from(u).cast()).collect()
            }
            NodeCompliance::Computed(grid) => {
                let field = grid.field(forces);
                (0..grid.len() as u32).map(field).collect()
            }
        }
    }
}

/// Displacement of each node (M) under unit forces on itself (m/N).
fn own(compliance: &Responses) -> Vec<Matrix3<f64>> {
    let own = |node| Matrix3::from_fn(|i, j| compliance.at(node, j, 3 * node as usize + i));
    (0..compliance.width() as u32 / 3).map(own).collect()
}

fn off(place: &Point3<f64>) -> Error {
    Error::invalid("pad", place, "meshes of one pad")
}

/// Skin nodes of the body that bear a force on each face node of a `coarse` mesh of the pad, and
/// the area that each of these represents (m²); `fine` is the mesh of the `condensed` pad. Returns
/// an error if the faces do not cover each other.
pub(super) fn tents(
    condensed: &Condensed,
    fine: &PadMesh,
    coarse: &PadMesh,
) -> Result<(Vec<Shares>, Vec<f64>)> {
    let areas = condensed.areas();
    let mut loads: Vec<Shares> = vec![Vec::new(); coarse.face.len()];
    for &node in &fine.face {
        let place = &condensed.rest.places()[node as usize];
        let (corners, shares) = coarse.under(place.x, place.y).ok_or_else(|| off(place))?;
        let rank = condensed.rank_of(node).ok_or_else(|| off(place))? as u32;
        for (corner, share) in corners.iter().zip(shares).filter(|(_, share)| *share > 0.0) {
            loads[*corner as usize].push((rank, share * areas[rank as usize]));
        }
    }
    let area = |loads: &Shares| loads.iter().map(|(_, area)| area).sum::<f64>();
    let borne: Vec<f64> = loads.iter().map(area).collect();
    for (loads, area) in loads.iter_mut().zip(&borne) {
        for (_, share) in loads {
            *share /= area;
        }
    }
    Ok((loads, borne))
}

/// Displacement interpolated at each of `sights` under unit forces on each of `loads` (3M, 3M) in
/// m/N.
fn condensed_between(condensed: &Condensed, loads: &[Shares], sights: &[Shares]) -> Responses {
    let size = 3 * condensed.skin.len();
    let mut compliance = Responses::new(3 * sights.len());
    let mut row = vec![0.0; size];
    for (loads, axis) in loads.iter().flat_map(|loads| [0, 1, 2].map(|axis| (loads, axis))) {
        row.fill(0.0);
        for &(rank, share) in loads {
            let rows = &condensed.rows(rank)[axis * size..][..size];
            row.iter_mut().zip(rows).for_each(|(sum, c)| *sum += share * c);
        }
        let seen = |(shares, i): (&Shares, usize)| {
            shares.iter().map(|&(rank, share)| row[3 * rank as usize + i] * share).sum::<f64>()
        };
        let sights = sights.iter().flat_map(|shares| [0, 1, 2].map(|i| (shares, i)));
        compliance.push(sights.map(seen));
    }
    compliance
}
