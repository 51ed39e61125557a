//! The symmetric sparse matrix of node-to-node couplings, and its Cholesky factorisation by faer.
//!
//! Only the upper triangle is stored, by columns. Unknowns are numbered in elimination order, three
//! to a node, so the matrix consists of 3 × 3 blocks and a block is added without searching.

use faer::{
    Conj, MatMut, Par, Side, Spec,
    dyn_stack::{MemBuffer, MemStack, StackReq},
    linalg::cholesky::llt::factor::LltRegularization,
    sparse::{
        SparseColMatRef, SymbolicSparseColMatRef,
        linalg::cholesky::{
            CholeskySymbolicParams, SymbolicCholesky, SymmetricOrdering,
            factorize_symbolic_cholesky,
        },
    },
};
use nalgebra::{Matrix3, Point3, Vector3};

use super::ordering::nested_dissection;

/// Place of a node that is held fixed, in the order of elimination.
pub(super) const FIXED: u32 = u32::MAX;

/// Where the couplings of a mesh lie in the matrix; computed once per mesh.
pub(super) struct Pattern {
    /// Place of each node in the order of elimination, or [`FIXED`] (N).
    pub(super) place: Vec<u32>,
    /// First block of each free node's column of blocks.
    first_block: Vec<u32>,
    /// Place of each block's row.
    block_row: Vec<u32>,
    /// First entry of each column of numbers.
    column: Vec<u32>,
    /// Row of each entry.
    row: Vec<u32>,
    symbolic: SymbolicCholesky<u32>,
}

/// Values of the upper triangle, and the factor L of L Lᵀ made from them.
pub(super) struct Matrix {
    values: Vec<f64>,
    factor: Vec<f64>,
    scratch: MemBuffer,
}

impl Pattern {
    /// Couples all nodes of each set in `cells`; nodes in `fixed` are left out. Of two orders of
    /// elimination the one with less fill is taken: nested dissection wins on large meshes, minimum
    /// degree on small and quadratic ones.
    pub(super) fn new(places: &[Point3<f64>], fixed: &[bool], cells: &[&[u32]]) -> Self {
        let neighbours = neighbours(places.len(), fixed, cells);
        let free: Vec<u32> = (0..places.len() as u32).filter(|&n| !fixed[n as usize]).collect();
        let dissected = Self::ordered(&nested_dissection(&free, places, &neighbours), &neighbours);
        let least_degree = Self::ordered(&minimum_degree(&dissected, &free), &neighbours);
        if dissected.fill() <= least_degree.fill() { dissected } else { least_degree }
    }

    /// The pattern with the free nodes eliminated in `order`.
    fn ordered(order: &[u32], neighbours: &[Vec<u32>]) -> Self {
        let mut place = vec![FIXED; neighbours.len()];
        for (i, &node) in order.iter().enumerate() {
            place[node as usize] = i as u32;
        }
        let (first_block, block_row) = block_columns(order, &place, neighbours);
        let (column, row) = columns(&first_block, &block_row);
        let symbolic = analyse(&column, &row, SymmetricOrdering::Identity);
        Self { place, first_block, block_row, column, row, symbolic }
    }

    /// Number of unknowns.
    pub(super) fn size(&self) -> usize {
        self.column.len() - 1
    }

    /// Entries of the factor.
    pub(super) fn fill(&self) -> usize {
        self.symbolic.len_val()
    }

    /// Index of the block that couples two free nodes, given by their places, `high >= low`.
    pub(super) fn block(&self, high: u32, low: u32) -> u32 {
        let first = self.first_block[high as usize] as usize;
        let end = self.first_block[high as usize + 1] as usize;
        let found = self.block_row[first..end].binary_search(&low);
        (first + found.expect("a cell couples all its nodes")) as u32
    }

    /// Values of the matrix, all zero.
    pub(super) fn matrix(&self) -> Matrix {
        let needs = StackReq::any_of(&[
            self.symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Spec::default()),
            self.solve_needs(),
        ]);
        Matrix {
            values: vec![0.0; self.row.len()],
            factor: vec![0.0; self.symbolic.len_val()],
            scratch: MemBuffer::new(needs),
        }
    }

    fn solve_needs(&self) -> StackReq {
        self.symbolic.solve_in_place_scratch::<f64>(MOST_COLUMNS, Par::Seq)
    }

    /// Working memory of [`Factor::solve`].
    pub(super) fn workspace(&self) -> MemBuffer {
        MemBuffer::new(self.solve_needs())
    }

    /// A nodal vector (N) as unknowns.
    pub(super) fn gather(&self, nodal: &[Vector3<f64>]) -> Vec<f64> {
        let mut unknowns = vec![0.0; self.size()];
        for (value, &place) in nodal.iter().zip(&self.place).filter(|&(_, &place)| place != FIXED) {
            unknowns[3 * place as usize..][..3].copy_from_slice(value.as_slice());
        }
        unknowns
    }

    /// Unknowns as a nodal vector (N), zero where nodes are fixed.
    pub(super) fn scatter(&self, unknowns: &[f64]) -> Vec<Vector3<f64>> {
        let at = |&place: &u32| match place {
            FIXED => Vector3::zeros(),
            _ => Vector3::from_column_slice(&unknowns[3 * place as usize..][..3]),
        };
        self.place.iter().map(at).collect()
    }
}

/// Most right-hand sides solved at once.
pub(super) const MOST_COLUMNS: usize = 8;

impl Matrix {
    /// Sets every value to zero.
    pub(super) fn clear(&mut self) {
        self.values.fill(0.0);
    }

    /// Adds `value`, the derivative of the force on the node at place `high` by the displacement of
    /// an earlier one, to their `block`.
    pub(super) fn add(&mut self, pattern: &Pattern, high: u32, block: u32, value: &Matrix3<f64>) {
        let high = high as usize;
        let rank = (block - pattern.first_block[high]) as usize;
        let diagonal = block + 1 == pattern.first_block[high + 1];
        for i in 0..3 {
            let top = pattern.column[3 * high + i] as usize + 3 * rank;
            // On the diagonal only the upper triangle exists.
            let rows = if diagonal { i + 1 } else { 3 };
            for (j, entry) in self.values[top..top + rows].iter_mut().enumerate() {
                *entry += value[(i, j)];
            }
        }
    }

    /// Adds `value` to the diagonal.
    pub(super) fn shift(&mut self, pattern: &Pattern, value: f64) {
        for &end in &pattern.column[1..] {
            self.values[end as usize - 1] += value;
        }
    }

    /// Mean of the diagonal.
    pub(super) fn mean_diagonal(&self, pattern: &Pattern) -> f64 {
        let ends = &pattern.column[1..];
        ends.iter().map(|&end| self.values[end as usize - 1]).sum::<f64>() / ends.len() as f64
    }

    /// Factorises the values; false if they are not positive definite.
    pub(super) fn factorise(&mut self, pattern: &Pattern) -> bool {
        let size = pattern.size();
        let rows =
            SymbolicSparseColMatRef::new_checked(size, size, &pattern.column, None, &pattern.row);
        let matrix = SparseColMatRef::new(rows, &self.values[..]);
        let factorised = pattern.symbolic.factorize_numeric_llt(
            &mut self.factor,
            matrix,
            Side::Upper,
            LltRegularization::default(),
            Par::Seq,
            MemStack::new(&mut self.scratch),
            Spec::default(),
        );
        factorised.is_ok()
    }

    /// Solves for up to [`MOST_COLUMNS`] right-hand sides in place, after [`Matrix::factorise`].
    pub(super) fn solve(&mut self, pattern: &Pattern, right: &mut [f64]) {
        solve(pattern, &self.factor, &mut self.scratch, right);
    }

    /// The factor alone, after [`Matrix::factorise`].
    pub(super) fn into_factor(self) -> Factor {
        Factor { values: self.factor }
    }
}

/// The factor L of L Lᵀ, to be shared between threads.
pub(super) struct Factor {
    values: Vec<f64>,
}

impl Factor {
    /// Solves for up to [`MOST_COLUMNS`] right-hand sides in place, in a [`Pattern::workspace`].
    pub(super) fn solve(&self, pattern: &Pattern, workspace: &mut MemBuffer, right: &mut [f64]) {
        solve(pattern, &self.values, workspace, right);
    }
}

fn solve(pattern: &Pattern, factor: &[f64], workspace: &mut MemBuffer, right: &mut [f64]) {
    let size = pattern.size();
    let columns = right.len() / size;
    let factor = faer::sparse::linalg::cholesky::LltRef::new(&pattern.symbolic, factor);
    let right = MatMut::from_column_major_slice_mut(right, size, columns);
    factor.solve_in_place_with_conj(Conj::No, right, Par::Seq, MemStack::new(workspace));
}

/// Symbolic factorisation of a pattern, given by its upper triangle.
fn analyse(
    column: &[u32],
    row: &[u32],
    order: SymmetricOrdering<'_, u32>,
) -> SymbolicCholesky<u32> {
    let size = column.len() - 1;
    let pattern = SymbolicSparseColMatRef::new_checked(size, size, column, None, row);
    factorize_symbolic_cholesky(pattern, Side::Upper, order, CholeskySymbolicParams::default())
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
