//! Sparsity pattern of the stiffness matrix: the coupled nodes of a mesh and the order of their
//! elimination.
//!
//! Unknowns are numbered in elimination order, three to a node, so a matrix consists of 3 × 3
//! blocks. Those on and above the diagonal are stored, column by column of numbers.

use faer::{
    Side,
    sparse::{
        SymbolicSparseColMatRef,
        linalg::{
            SupernodalThreshold,
            cholesky::{
                CholeskySymbolicParams, SymbolicCholesky, SymmetricOrdering,
                factorize_symbolic_cholesky,
            },
        },
    },
};
use nalgebra::{Point3, Vector3};

use super::ordering::nested_dissection;

/// Value that marks a fixed node, which has no place in the order of elimination.
pub(super) const FIXED: u32 = u32::MAX;

/// Positions of the couplings of a mesh in the matrix.
pub(super) struct Pattern {
    /// Place of each node in the order of elimination, or [`FIXED`] (N).
    pub(super) place: Vec<u32>,
    /// First block of each free node's column of blocks.
    first_block: Vec<u32>,
    /// Place of the node of each block's row.
    block_row: Vec<u32>,
    /// First entry of each column of numbers.
    pub(super) column: Vec<u32>,
    /// Row of each entry.
    pub(super) row: Vec<u32>,
    pub(super) symbolic: SymbolicCholesky<u32>,
    /// Unknowns that are eliminated last, all coupled with each other.
    pub(super) last: usize,
}

/// Position of the coupling of two nodes among the values of a matrix.
#[derive(Clone, Copy, Debug)]
pub(super) struct BlockPosition {
    /// First entry.
    pub(super) first: u32,
    /// Entries of the first column above the block on the diagonal.
    pub(super) above: u32,
    /// `true` for a block on the diagonal, of which only the upper triangle is stored.
    pub(super) diagonal: bool,
    /// `true` if the second node is eliminated later.
    pub(super) turned: bool,
}

impl Pattern {
    /// Couples all nodes of each set in `cells`; nodes in `fixed` are left out. Of two orders of
    /// elimination the one with less fill is taken: nested dissection wins on large meshes, minimum
    /// degree on small and quadratic ones.
    pub(super) fn new(places: &[Point3<f64>], fixed: &[bool], cells: &[&[u32]]) -> Self {
        Self::ending_in(&[], places, fixed, cells)
    }

    /// Returns [`Pattern::new`] with the free nodes `last` all coupled with each other and
    /// eliminated last.
    pub(super) fn ending_in(
        last: &[u32],
        places: &[Point3<f64>],
        fixed: &[bool],
        cells: &[&[u32]],
    ) -> Self {
        let together: Vec<&[u32]> = cells.iter().copied().chain([last]).collect();
        let neighbours = neighbours(places.len(), fixed, &together);
        let is_free = |&n: &u32| !fixed[n as usize];
        let free: Vec<u32> = (0..places.len() as u32).filter(is_free).collect();
        let mut is_last = vec![false; places.len()];
        for &node in last {
            is_last[node as usize] = true;
        }
        let first: Vec<u32> = free.iter().copied().filter(|&n| !is_last[n as usize]).collect();
        let ordered = |mut order: Vec<u32>| {
            order.retain(|&node| !is_last[node as usize]);
            order.extend(last);
            Self::ordered(&order, &neighbours, 3 * last.len())
        };
        let dissected = ordered(nested_dissection(&first, places, &neighbours));
        let least_degree = ordered(minimum_degree(&dissected, &free));
        if dissected.fill() <= least_degree.fill() { dissected } else { least_degree }
    }

    /// Returns the pattern with the free nodes eliminated in `order`, whose last `last` unknowns
    /// form a block.
    fn ordered(order: &[u32], neighbours: &[Vec<u32>], last: usize) -> Self {
        let mut place = vec![FIXED; neighbours.len()];
        for (i, &node) in order.iter().enumerate() {
            place[node as usize] = i as u32;
        }
        let (first_block, block_row) = block_columns(order, &place, neighbours);
        let (column, row) = columns(&first_block, &block_row);
        let symbolic = analyse(&column, &row, SymmetricOrdering::Identity);
        Self { place, first_block, block_row, column, row, symbolic, last }
    }

    /// Number of unknowns.
    pub(super) fn size(&self) -> usize {
        self.column.len() - 1
    }

    /// Entries of the factor.
    pub(super) fn fill(&self) -> usize {
        self.symbolic.len_val()
    }

    /// Position of the derivative of the force on `a` with respect to the displacement of `b`, for
    /// two coupled nodes; `None` if one of them is fixed.
    pub(super) fn position(&self, a: u32, b: u32) -> Option<BlockPosition> {
        let [a, b] = [a, b].map(|node| self.place[node as usize]);
        if a == FIXED || b == FIXED {
            return None;
        }
        let (high, low) = (a.max(b) as usize, a.min(b));
        let rows = &self.block_row[self.first_block[high] as usize..][..self.blocks(high)];
        let rank = rows.binary_search(&low).expect("a cell couples all its nodes") as u32;
        let (diagonal, turned) = (a == b, a < b);
        let above = 3 * (rows.len() as u32 - 1);
        Some(BlockPosition { first: self.column[3 * high] + 3 * rank, above, diagonal, turned })
    }

    /// Number of blocks of the node at place `high` with itself and earlier ones.
    fn blocks(&self, high: usize) -> usize {
        (self.first_block[high + 1] - self.first_block[high]) as usize
    }

    /// Converts a nodal vector (N) to unknowns.
    pub(super) fn gather(&self, nodal: &[Vector3<f64>]) -> Vec<f64> {
        let mut unknowns = vec![0.0; self.size()];
        for (value, &place) in nodal.iter().zip(&self.place).filter(|&(_, &place)| place != FIXED) {
            unknowns[3 * place as usize..][..3].copy_from_slice(value.as_slice());
        }
        unknowns
    }

    /// Converts unknowns to a nodal vector (N), zero where nodes are fixed.
    pub(super) fn scatter(&self, unknowns: &[f64]) -> Vec<Vector3<f64>> {
        let at = |&place: &u32| match place {
            FIXED => Vector3::zeros(),
            _ => Vector3::from_column_slice(&unknowns[3 * place as usize..][..3]),
        };
        self.place.iter().map(at).collect()
    }
}

/// Symbolic factorisation of a pattern, given by its upper triangle.
fn analyse(
    column: &[u32],
    row: &[u32],
    order: SymmetricOrdering<'_, u32>,
) -> SymbolicCholesky<u32> {
    let size = column.len() - 1;
    let pattern = SymbolicSparseColMatRef::new_checked(size, size, column, None, row);
    let supernodal_flop_ratio_threshold = SupernodalThreshold::FORCE_SUPERNODAL;
    let params = CholeskySymbolicParams { supernodal_flop_ratio_threshold, ..Default::default() };
    factorize_symbolic_cholesky(pattern, Side::Upper, order, params)
        .expect("indices fit in 32 bits")
}

/// `free` nodes ordered by approximate minimum degree (Amestoy, Davis and Duff 1996), as faer does.
fn minimum_degree(pattern: &Pattern, free: &[u32]) -> Vec<u32> {
    let Pattern { place, first_block, block_row, .. } = pattern;
    let symbolic = analyse(first_block, block_row, SymmetricOrdering::Amd);
    let mut node_at = vec![0; free.len()];
    for &node in free {
        node_at[place[node as usize] as usize] = node;
    }
    match symbolic.perm() {
        Some(order) => order.arrays().0.iter().map(|&i| node_at[i as usize]).collect(),
        None => node_at,
    }
}

/// For each free node the free nodes that share a cell with it, itself included, ascending.
fn neighbours(count: usize, fixed: &[bool], cells: &[&[u32]]) -> Vec<Vec<u32>> {
    let mut neighbours = vec![Vec::new(); count];
    for cell in cells {
        let free: Vec<u32> = cell.iter().copied().filter(|&n| !fixed[n as usize]).collect();
        for &node in &free {
            neighbours[node as usize].extend(&free);
        }
    }
    for list in &mut neighbours {
        list.sort_unstable();
        list.dedup();
    }
    neighbours
}

/// Rows of the blocks at and above the diagonal, column by column of blocks.
fn block_columns(order: &[u32], place: &[u32], neighbours: &[Vec<u32>]) -> (Vec<u32>, Vec<u32>) {
    let (mut first, mut rows) = (vec![0], Vec::new());
    for (high, &node) in order.iter().enumerate() {
        let start = rows.len();
        let places = neighbours[node as usize].iter().map(|&n| place[n as usize]);
        rows.extend(places.filter(|&low| low <= high as u32));
        rows[start..].sort_unstable();
        first.push(rows.len() as u32);
    }
    (first, rows)
}

/// Columns of numbers and their rows, from the blocks.
fn columns(first_block: &[u32], block_row: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let (mut column, mut row) = (vec![0], Vec::new());
    for ends in first_block.windows(2) {
        let blocks = &block_row[ends[0] as usize..ends[1] as usize];
        for j in 0..3 {
            let rows = 3 * blocks.len() - 2 + j;
            row.extend(blocks.iter().flat_map(|&b| (0..3).map(move |i| 3 * b + i)).take(rows));
            column.push(row.len() as u32);
        }
    }
    (column, row)
}
