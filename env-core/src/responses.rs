//! Linear responses to unit forces on nodes, stored with 16 bits per number.
//!
//! Sums over such rows are limited by memory bandwidth, so half the bytes nearly double the speed.
//! A row is stored in units of 1/32767 of its largest number, which is the response of the loaded
//! node itself; under hundreds of forces the rounding adds up to about 1e-5 of the sum.

#![allow(clippy::inline_always)] // Code that is not inlined is not compiled for the processor.

use nalgebra::Vector3;

use crate::simd::{LANES, add_rows, vectorised};

/// Three rows of numbers for each node, one for a unit force along each axis.
pub(crate) struct Responses {
    /// Numbers in a row.
    width: usize,
    /// Rows, each filled up with zeros to whole parts of [`LANES`] numbers.
    numbers: Vec<i16>,
    /// Unit of each row.
    units: Vec<f32>,
}

/// Largest number of a row in its unit.
const LARGEST: f64 = 32767.0;

impl Responses {
    /// Returns an empty table for rows of `width` numbers.
    pub(crate) fn new(width: usize) -> Self {
        Self { width, numbers: Vec::new(), units: Vec::new() }
    }

    /// Adds the next row.
    ///
    /// # Panics
    /// If it is not as wide as the others.
    pub(crate) fn push(&mut self, row: impl Iterator<Item = f64> + Clone) {
        let largest = row.clone().map(f64::abs).fold(0.0, f64::max);
        let unit = (largest / LARGEST) as f32;
        let inverse = if unit > 0.0 { 1.0 / f64::from(unit) } else { 0.0 };
        let first = self.numbers.len();
        self.numbers.extend(row.map(|x| (x * inverse).round() as i16));
        assert_eq!(self.numbers.len(), first + self.width, "rows of one width");
        self.numbers.resize(first + self.len(), 0);
        self.units.push(unit);
    }

    /// Numbers in a row.
    pub(crate) fn width(&self) -> usize {
        self.width
    }

    /// Length of a sum of rows: their width, rounded up to whole parts of [`LANES`] numbers.
    pub(crate) fn len(&self) -> usize {
        self.width.next_multiple_of(LANES)
    }

    /// Adds the response to `force` on `node` to a `sum` of [`Responses::len`] numbers.
    pub(crate) fn add(&self, node: u32, force: &Vector3<f64>, sum: &mut [f32]) {
        self.add_to(node, force, &[[0, self.len()]], sum);
    }

    /// Performs [`Responses::add`] in some `runs` of the sum alone, each of whole
    /// [`PIECE`](crate::simd::PIECE)s.
    pub(crate) fn add_to(
        &self,
        node: u32,
        force: &Vector3<f64>,
        runs: &[[usize; 2]],
        sum: &mut [f32],
    ) {
        let (first, width) = (3 * node as usize, self.len());
        let rows = [0, 1, 2].map(|axis| &self.numbers[(first + axis) * width..][..width]);
        let units = &self.units[first..first + 3];
        let by = std::array::from_fn(|axis| force[axis] as f32 * units[axis]);
        vectorised(
            #[inline(always)]
            || {
                for &[first, last] in runs {
                    let rows = rows.map(|row| &row[first..last]);
                    add_rows(&mut sum[first..last], rows, by);
                }
            },
        );
    }

    /// Number in `column` of the row of `node` and `axis`.
    pub(crate) fn at(&self, node: u32, axis: usize, column: usize) -> f64 {
        let row = 3 * node as usize + axis;
        f64::from(self.units[row]) * f64::from(self.numbers[row * self.len() + column])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_added_up_to_rounding_whatever_their_length() {
        for size in [1, 15, 16, 17, 675] {
            let row = |k: usize| (0..size).map(move |i| ((7 * i + 3 * k) % 11) as f64 - 4.0);
            let mut responses = Responses::new(size);
            (0..6).for_each(|k| responses.push(row(k)));
            let force = Vector3::new(2.0, -3.0, 0.5);
            let mut sum = vec![1.0; responses.len()];
            responses.add(1, &force, &mut sum);
            for (i, found) in sum[..size].iter().enumerate() {
                let terms = (0..3).map(|axis| force[axis] * row(3 + axis).nth(i).unwrap());
                let expected = 1.0 + terms.sum::<f64>();
                let step = 6.0 / LARGEST;
                assert!((f64::from(*found) - expected).abs() < 3.0 * step, "{i} of {size}");
                assert!((responses.at(1, 2, i) - row(5).nth(i).unwrap()).abs() <= 0.51 * step);
            }
        }
    }

    #[test]
    fn a_row_of_nothing_is_nothing() {
        let mut responses = Responses::new(4);
        (0..3).for_each(|_| responses.push([0.0; 4].into_iter()));
        let mut sum = vec![0.0; responses.len()];
        responses.add(0, &Vector3::repeat(1.0), &mut sum);
        assert_eq!(sum, [0.0; LANES]);
    }

    #[test]
    fn runs_are_added_as_in_the_whole_row_and_nothing_else_is() {
        let mut responses = Responses::new(75);
        (0..3).for_each(|k| responses.push((0..75).map(move |i| f64::from((5 * i + k) % 13))));
        let (force, runs) = (Vector3::new(1.0, -2.0, 0.5), [[0, 24], [40, 48], [56, 80]]);
        let (mut whole, mut parts) = (vec![0.0; 80], vec![0.0; 80]);
        responses.add(0, &force, &mut whole);
        responses.add_to(0, &force, &runs, &mut parts);
        whole[24..40].fill(0.0);
        whole[48..56].fill(0.0);
        assert_eq!(parts, whole);
    }
}
