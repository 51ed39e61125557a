//! Nodes near the shapes in one load step, and Gauss–Seidel sweeps over their forces.
//!
//! A touching node is pushed to its target: on the shape's tangent plane, at the place where
//! friction holds it. With C the node's own compliance, K the stiffness of the contact law and r
//! the vector to the target less K⁻¹ f, the change of force follows from (C + K⁻¹) δf = r. The
//! force is then projected on Coulomb's cone, with the direction of sliding by the proximal form of
//! Alart and Curnier (1991).

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

use super::{
    between::FELT,
    contact_nodes::{ContactNodes, NodeCompliance},
    spots::Spots,
    state::{Held, forces},
};
use crate::{
    contact::{ContactLaw, PointGroup, SurfacePoint, first_touch, gap, nearest, went_through},
    geometry::{Distance, Shape},
    simd::PIECE,
};

/// Least cosine between the normal of a shape where a node entered it and that at its nearest point
/// to the node. If they differ by more, the node is pushed out where it entered.
const TURNED: f64 = 0.5;
/// Cosine between the outward normals of body and shape above which the shape is on the wrong side
/// of the skin. Where body and shape touch, these normals oppose each other.
const FOLDED: f64 = 0.5;
/// Cosine between the outward normals of body and shape above which the shape touches with a flank
/// and not with its end.
const FLANK: f64 = -0.2;
/// Number of parts in which the line between two neighbouring cells is looked at.
const PARTS: u32 = 8;
/// Length between two runs up to which they are merged: fewer, longer runs are faster in spite of
/// the additional numbers.
const BRIDGE: usize = PIECE;

/// Largest working memory that a thread keeps between presses (bytes). Without a bound it would keep
/// what the largest press has needed.
const MOST_KEPT: usize = 4 << 20;

/// Working memory of one thread, reused for successive presses.
#[derive(Default)]
pub(super) struct NodalScratch {
    pub(super) displacement: Vec<f32>,
    pub(super) spots: Spots,
}

impl NodalScratch {
    /// Returns it as it is, or an empty one in place of one that is larger than [`MOST_KEPT`].
    pub(super) fn trimmed(self) -> Self {
        let bytes = size_of::<f32>() * self.displacement.capacity() + self.spots.bytes();
        if bytes <= MOST_KEPT { self } else { Self::default() }
    }
}

/// Motion of the shapes in one load step.
#[derive(Clone, Copy)]
pub(super) struct Move<'a> {
    pub(super) shapes: &'a [Shape],
    pub(super) from: &'a [Isometry3<f64>],
    pub(super) to: &'a [Isometry3<f64>],
}

/// Nodes that the shapes may touch in one load step.
pub(super) struct Patch<'a> {
    nodes: &'a ContactNodes,
    law: &'a ContactLaw,
    motion: Move<'a>,
    pub(super) members: Vec<Member>,
    /// Ranges of the displacement that follow the forces in sweeps.
    pub(super) runs: Vec<[usize; 2]>,
    /// Displacement in m: by rank and valid only in the runs, or on a grid that of the spots.
    pub(super) displacement: &'a mut Vec<f32>,
    /// Cells on a grid.
    spots: &'a mut Spots,
}

/// Node of a patch.
pub(super) struct Member {
    rank: u32,
    /// Number of its cell among the spots, on a grid.
    spot: u32,
    /// Position at rest (m).
    rest: Point3<f64>,
    pub(super) force: Vector3<f64>,
    /// Position at the beginning of the step (m).
    start: Point3<f64>,
    /// Shape that it sticks to, and the place in the shape's frame.
    stuck: Option<(u32, Point3<f64>)>,
    /// Last measured position, and the distance there (m).
    seen: (Point3<f64>, f64),
    /// Target of a touching node.
    pub(super) target: Option<NodeTarget>,
}

/// Position to which a touching node is pushed.
#[derive(Clone, Copy)]
pub(super) struct NodeTarget {
    normal: Vector3<f64>,
    /// Displacement of the node at the target (m).
    displacement: Vector3<f64>,
    /// Own compliance C of the node (m/N).
    own: Matrix3<f64>,
    /// C + K⁻¹, with K⁻¹ the compliance of the contact (m/N).
    compliance: Matrix3<f64>,
    /// Inverse of `compliance` (N/m).
    stiffness: Matrix3<f64>,
    /// `stiffness` × C: part of the old force in a new one.
    kept: Matrix3<f64>,
}

impl<'a> Patch<'a> {
    /// Collects the nodes that, at their positions at the beginning of the step, are within `reach`
    /// (m) of a shape at the end of the step, and those that are `held`; no node may be displaced
    /// by more than `room` − `reach`. `None` if more than `most` cells of a grid lie inside shapes.
    pub(super) fn new(
        nodes: &'a ContactNodes,
        law: &'a ContactLaw,
        motion: Move<'a>,
        [room, reach]: [f64; 2],
        most: usize,
        held: &[Held],
        scratch: &'a mut NodalScratch,
    ) -> Option<Self> {
        let ranks = candidates(nodes, motion, [room, reach], most, held)?;
        let moved = moved_by(nodes, &ranks, held, scratch);
        let members = within_reach(nodes, motion, reach, (&ranks, &moved), held);
        let is_computed = matches!(nodes.compliance, NodeCompliance::Computed(_));
        if is_computed && members.iter().filter(|member| member.seen.1 <= 0.0).count() > most {
            return None;
        }
        // Of a computed compliance, the runs are those of the touching cells.
        let stored = if is_computed { &[] } else { &members[..] };
        let runs = runs(stored.iter().map(|member| member.rank));
        let NodalScratch { displacement, spots } = scratch;
        Some(Self { nodes, law, motion, members, runs, displacement, spots })
    }

    /// Brings the displacement of all members up to date.
    pub(super) fn catch_up(&mut self) {
        if let NodeCompliance::Computed(grid) = &self.nodes.compliance {
            for member in self.members.iter().filter(|member| member.stuck.is_some()) {
                self.spots.update_passive(
                    grid,
                    member.spot as usize,
                    &member.force,
                    self.displacement,
                );
            }
        }
    }

    /// Measures the nodes' distances from the shapes and sets the targets; returns whether a node
    /// touches.
    pub(super) fn measure(&mut self) -> bool {
        self.catch_up();
        let mut touches = false;
        for i in 0..self.members.len() {
            let Member { force, seen, .. } = self.members[i];
            let place = self.place(&self.members[i]);
            let loose = force == Vector3::zeros();
            if loose && (place - seen.0).norm() < seen.1 {
                self.members[i].target = None;
                continue;
            }
            let (shape, distance) = nearest(self.motion.shapes, self.motion.to, &place);
            self.members[i].seen = (place, distance.value);
            self.members[i].target = (!loose || distance.value < 0.0).then(|| {
                touches = true;
                self.target(i, shape, &distance, &place)
            });
        }
        if matches!(self.nodes.compliance, NodeCompliance::Computed(_)) {
            let touching = self.members.iter().filter(|member| member.target.is_some());
            self.runs = self.spots.activate(touching.map(|member| member.spot));
        }
        touches
    }

    /// Target of the touching member `i`.
    fn target(
        &mut self,
        i: usize,
        shape: u32,
        distance: &Distance,
        place: &Point3<f64>,
    ) -> NodeTarget {
        let (form, pose) = (&self.motion.shapes[shape as usize], &self.motion.to[shape as usize]);
        let member = &mut self.members[i];
        let stuck = member.stuck.filter(|(held_by, _)| *held_by == shape);
        let (_, stuck) = *member
            .stuck
            .insert(stuck.unwrap_or_else(|| (shape, self.motion.touch(shape, &member.start))));
        let entered = (distance.value < -self.law.deep())
            .then(|| entered(form, &stuck, &pose.inverse_transform_point(place)))
            .flatten()
            .map(|Distance { value, normal }| Distance { value, normal: pose.rotation * normal })
            .filter(|entered| entered.normal.dot(&distance.normal) < TURNED);
        let Distance { value, normal } = entered.unwrap_or(*distance);
        let surface = place - normal * value;
        let stuck = pose * stuck;
        let aim = stuck - normal * normal.dot(&(stuck - surface));
        let give = give(self.law, self.nodes.point(member.rank), &normal);
        let own = match &self.nodes.compliance {
            NodeCompliance::Computed(grid) => self.spots.own_compliance(grid, member.spot as usize),
            NodeCompliance::Stored(..) => self.nodes.own(member.rank),
        };
        let compliance = own + give;
        let stiffness = compliance.try_inverse().unwrap_or_else(Matrix3::zeros);
        let displacement = aim - member.rest;
        NodeTarget { normal, displacement, own, compliance, stiffness, kept: stiffness * own }
    }

    /// New force on a touching member, pushed to its `target`.
    fn pushed(&self, member: &Member, target: &NodeTarget) -> Vector3<f64> {
        let away = target.displacement - self.moved(member);
        target.force(&member.force, &away, self.law.friction)
    }

    /// Performs one sweep over the touching nodes, in reverse order if `back`. Returns the largest
    /// change of a force and the largest force (N).
    pub(super) fn sweep(&mut self, back: bool) -> (f64, f64) {
        let (mut change, mut strongest) = (0f64, 0f64);
        let count = self.members.len();
        for i in 0..count {
            let i = if back { count - 1 - i } else { i };
            let member = &self.members[i];
            let Some(target) = &member.target else { continue };
            let force = self.pushed(member, target);
            let step = force - member.force;
            self.members[i].force = force;
            let size = step.norm();
            strongest = strongest.max(force.norm());
            if size > 0.0 {
                change = change.max(size);
                self.add_response(i, &step);
            }
        }
        (change, strongest)
    }

    /// Adds to the displacement the response to a `force` on member `i`.
    fn add_response(&mut self, i: usize, force: &Vector3<f64>) {
        let Member { rank, spot, .. } = self.members[i];
        match &self.nodes.compliance {
            NodeCompliance::Stored(compliance, _) => {
                compliance.add_to(rank, force, &self.runs, self.displacement);
            }
            NodeCompliance::Computed(grid) => {
                self.spots.add_response(grid, spot as usize, force, self.displacement);
            }
        }
    }

    /// Displacement of a member (m).
    fn moved(&self, member: &Member) -> Vector3<f64> {
        match &self.nodes.compliance {
            NodeCompliance::Stored(..) => displaced(self.displacement, member.rank),
            NodeCompliance::Computed(_) => {
                self.spots.moved(member.spot as usize, self.displacement)
            }
        }
    }

    /// Position of a member (m).
    fn place(&self, member: &Member) -> Point3<f64> {
        member.rest + self.moved(member)
    }

    /// Returns whether a node passed through a shape in this step.
    pub(super) fn leaps(&self) -> bool {
        let depth = self.law.deep();
        self.members.iter().any(|member| {
            let place = self.place(member);
            let near = member.seen.1 - (place - member.seen.0).norm();
            self.motion.ends(&member.start, &place).any(|(shape, [begin, end])| {
                let length = (end - begin).norm();
                length > 2.0 * depth && length > near && went_through(shape, &begin, &end, depth)
            })
        })
    }

    /// Returns whether a shape presses a node from inside the body: the skin is folded round it.
    pub(super) fn folds(&self) -> bool {
        let pressed = self.members.iter().filter(|member| member.force != Vector3::zeros());
        pressed
            .filter_map(|member| Some((member.rank, member.target?.normal)))
            .any(|(rank, out_of_shape)| out_of_shape.dot(&self.nodes.normal(rank)) > FOLDED)
    }

    /// Depth of a shape that is wedged between two neighbouring cells of a grid and touches them
    /// with its flanks only, and the depth allowed (m), if the former is larger: the shape has
    /// pierced the skin.
    pub(super) fn pierced(&self) -> Option<[f64; 2]> {
        let grid = self.nodes.grid()?;
        let at_flank = |member: &&Member| {
            member.force != Vector3::zeros()
                && member.target.is_some_and(|target| {
                    target.normal.dot(&self.nodes.normal(member.rank)) > FLANK
                })
        };
        let flanks: Vec<_> = self.members.iter().filter(at_flank).collect();
        for member in &flanks {
            let Some((shape, _)) = member.stuck else { continue };
            let (shape, pose) =
                (&self.motion.shapes[shape as usize], &self.motion.to[shape as usize]);
            let place = |member| pose.inverse_transform_point(&self.place(member));
            let (begin, allowed) = (place(member), FELT * shape.thickness());
            for rank in grid.later_neighbours(member.rank) {
                let Ok(k) = flanks.binary_search_by_key(&rank, |flank| flank.rank) else {
                    continue;
                };
                let across = place(flanks[k]) - begin;
                if across.norm() < 2.0 * allowed {
                    continue;
                }
                let at = |i: u32| begin + across * (f64::from(i) / f64::from(PARTS));
                let depth = (1..PARTS).map(|i| -shape.distance(&at(i)).value).fold(0.0, f64::max);
                if depth > allowed {
                    return Some([depth, allowed]);
                }
            }
        }
        None
    }

    /// Number of members that touch.
    pub(super) fn touching(&self) -> usize {
        self.members.iter().filter(|member| member.target.is_some()).count()
    }

    /// Largest displacement of a member (m).
    pub(super) fn amplitude(&self) -> f64 {
        self.members.iter().map(|member| self.moved(member).norm()).fold(0.0, f64::max)
    }

    /// Touching nodes with their positions.
    pub(super) fn held(&self) -> Vec<(Held, Point3<f64>)> {
        let touching = self.members.iter().filter(|member| member.force != Vector3::zeros());
        let held = |member: &Member| {
            let place = self.place(member);
            let target = member.target.expect("what has a force has been measured");
            let (shape, _) = member.stuck.expect("what touches sticks somewhere");
            let normal = target.normal;
            let along = member.force - normal * normal.dot(&member.force);
            let stretch = self.law.stick_give(self.nodes.point(member.rank)) * along;
            let stuck = self.motion.to[shape as usize].inverse_transform_point(&(place + stretch));
            let Member { rank, force, .. } = *member;
            (Held { rank, shape, stuck, force, normal }, place)
        };
        touching.map(held).collect()
    }
}

/// Ranks, ascending, of the nodes that may be within reach of a shape at the end of the step, and
/// of those that are `held`; see [`Patch::new`].
fn candidates(
    nodes: &ContactNodes,
    motion: Move,
    [room, reach]: [f64; 2],
    most: usize,
    held: &[Held],
) -> Option<Vec<u32>> {
    let mut ranks: Vec<u32> = match &nodes.compliance {
        NodeCompliance::Stored(..) => {
            let near = nodes.groups.iter().filter(|group| is_near(motion, group, room));
            near.flat_map(|group| group.numbers.iter().copied()).collect()
        }
        NodeCompliance::Computed(grid) => {
            grid.near((motion.shapes, motion.to), &forces(held), [room, reach], most)?
        }
    };
    ranks.extend(held.iter().map(|held| held.rank));
    ranks.sort_unstable();
    ranks.dedup();
    Some(ranks)
}

/// Displacement of the nodes of these `ranks` under the forces on those that are `held` (m). The
/// working memory is left with it.
fn moved_by(
    nodes: &ContactNodes,
    ranks: &[u32],
    held: &[Held],
    NodalScratch { displacement, spots }: &mut NodalScratch,
) -> Vec<Vector3<f64>> {
    match &nodes.compliance {
        NodeCompliance::Stored(compliance, _) => {
            let runs = runs(ranks.iter().copied());
            displacement.resize(compliance.len(), 0.0);
            for &[first, last] in &runs {
                displacement[first..last].fill(0.0);
            }
            for held in held {
                compliance.add_to(held.rank, &held.force, &runs, displacement);
            }
            ranks.iter().map(|&rank| displaced(displacement, rank)).collect()
        }
        NodeCompliance::Computed(grid) => {
            spots.renew(grid, ranks.iter().copied(), displacement);
            for Held { rank, force, .. } in held {
                let spot = ranks.binary_search(rank).expect("held cells are among all");
                spots.add_response(grid, spot, force, displacement);
                spots.update_passive(grid, spot, force, displacement);
            }
            (0..ranks.len()).map(|spot| spots.moved(spot, displacement)).collect()
        }
    }
}

/// Nodes of these `ranks`, already `moved` (m) at the beginning of the step, that are `held` or
/// within `reach` (m) of a shape at its end.
fn within_reach(
    nodes: &ContactNodes,
    motion: Move,
    reach: f64,
    (ranks, moved): (&[u32], &[Vector3<f64>]),
    held: &[Held],
) -> Vec<Member> {
    let mut held = held.iter().peekable();
    let member = |((spot, &rank), moved): ((u32, &u32), &Vector3<f64>)| {
        let known = held.next_if(|held| held.rank == rank);
        let rest = nodes.place(rank);
        let start = rest + moved;
        let distance = match known {
            Some(_) => 0.0,
            None => gap(motion.shapes, motion.to, &start),
        };
        (distance < reach).then(|| Member {
            rank,
            spot,
            rest,
            force: known.map(|held| held.force).unwrap_or_default(),
            start,
            stuck: known.map(|held| (held.shape, held.stuck)),
            seen: (start, distance),
            target: None,
        })
    };
    let mut members = Vec::with_capacity(ranks.len());
    members.extend((0..).zip(ranks).zip(moved).filter_map(member));
    members
}

impl NodeTarget {
    /// New force on a node with the force `old` that is `away` from its target (m).
    fn force(&self, old: &Vector3<f64>, away: &Vector3<f64>, friction: f64) -> Vector3<f64> {
        let n = &self.normal;
        // f + (C + K⁻¹)⁻¹ (away − K⁻¹ f), in products that do not wait for each other.
        let trial = self.kept * old + self.stiffness * away;
        let press = n.dot(&trial);
        if press > 0.0 && (trial - n * press).norm() <= friction * press {
            return trial;
        }
        let free = away + self.own * old;
        let off = free - self.compliance * old;
        let pull = old + off * (1.0 / (self.compliance.trace() - n.dot(&(self.compliance * n))));
        let pull = pull - n * n.dot(&pull);
        let along = pull.try_normalize(0.0).unwrap_or_default();
        let cone = n + along * friction;
        let press = n.dot(&free) / n.dot(&(self.compliance * cone));
        if press > 0.0 {
            n * press + along * f64::min(pull.norm(), friction * press)
        } else {
            Vector3::zeros()
        }
    }
}

impl Move<'_> {
    /// Shapes, with the ends of a point's path from `start` to `place` in the frame of each.
    fn ends(
        &self,
        start: &Point3<f64>,
        place: &Point3<f64>,
    ) -> impl Iterator<Item = (&Shape, [Point3<f64>; 2])> {
        let poses = self.from.iter().zip(self.to);
        self.shapes.iter().zip(poses).map(|(shape, (from, to))| {
            (shape, [from.inverse_transform_point(start), to.inverse_transform_point(place)])
        })
    }

    /// Place, in the shape's frame, where the moving shape meets a point at rest at `start`.
    fn touch(&self, shape: u32, start: &Point3<f64>) -> Point3<f64> {
        let s = shape as usize;
        let (from, to) = (&self.from[s], &self.to[s]);
        let seen_from = |t: f64| from.lerp_slerp(to, t).inverse_transform_point(start);
        seen_from(first_touch(|t| self.shapes[s].distance(&seen_from(t)).value))
    }
}

/// Distance of the point `place` inside a shape from the plane that touches it at `entry`, where
/// the point entered; none if it is outside of the plane.
fn entered(shape: &Shape, entry: &Point3<f64>, place: &Point3<f64>) -> Option<Distance> {
    let normal = shape.distance(entry).normal;
    let value = normal.dot(&(place - entry));
    (value < 0.0).then_some(Distance { value, normal })
}

/// Ranges of numbers, of whole [`PIECE`]s, that contain those of the ascending `ranks`.
fn runs(ranks: impl Iterator<Item = u32>) -> Vec<[usize; 2]> {
    let mut runs: Vec<[usize; 2]> = Vec::new();
    for rank in ranks {
        let first = 3 * rank as usize;
        let [first, last] = [first / PIECE * PIECE, (first + 3).next_multiple_of(PIECE)];
        match runs.last_mut() {
            Some([_, end]) if first <= *end + BRIDGE => *end = last,
            _ => runs.push([first, last]),
        }
    }
    runs
}

/// Compliance K⁻¹ of the contact at a node (m/N).
pub(super) fn give(law: &ContactLaw, point: &SurfacePoint, normal: &Vector3<f64>) -> Matrix3<f64> {
    let across = normal * normal.transpose();
    across * law.give(point) + (Matrix3::identity() - across) * law.stick_give(point)
}

/// Returns whether a node of `group`, displaced by less than `room` (m), may be near a shape.
fn is_near(motion: Move, group: &PointGroup, room: f64) -> bool {
    motion.shapes.iter().zip(motion.to).any(|(shape, pose)| {
        let centre = pose.inverse_transform_point(&group.centre);
        shape.distance(&centre).value < group.radius + room
    })
}

fn displaced(displacement: &[f32], rank: u32) -> Vector3<f64> {
    let u = &displacement[3 * rank as usize..][..3];
    Vector3::new(f64::from(u[0]), f64::from(u[1]), f64::from(u[2]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thread_keeps_what_usual_presses_need_and_not_what_the_largest_did() {
        let of = |numbers: usize| NodalScratch {
            displacement: Vec::with_capacity(numbers),
            ..NodalScratch::default()
        };
        let most = MOST_KEPT / size_of::<f32>();
        assert!(of(most / 2).trimmed().displacement.capacity() >= most / 2);
        assert_eq!(of(2 * most).trimmed().displacement.capacity(), 0);
    }
}
