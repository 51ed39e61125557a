//! Linear responses to unit forces on nodes, stored with 16 bits per number.
//!
//! Sums over such rows are limited by memory bandwidth, so half the bytes nearly double the speed.
//! A row is stored in units of 1/32767 of its largest number, which is the response of the loaded
//! node itself; under hundreds of forces the rounding adds up to about 1e-5 of the sum.

#![allow(clippy::inline_always)] // Code that is not inlined is not compiled for the processor.

use std::ops::Range;

use nalgebra::Vector3;

use crate::simd::vectorised;

/// Three rows of numbers for each node, one for a unit force along each axis.
pub(crate) struct Responses {
    /// Numbers in a row.
    width: usize,
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
        self.numbers.extend(row.map(|x| (x * inverse).round() as i16));
        self.units.push(unit);
        assert_eq!(self.numbers.len(), self.width * self.units.len(), "rows of one width");
    }

    /// Numbers in a row.
    pub(crate) fn width(&self) -> usize {
        self.width
    }

    /// Adds the response to `force` on `node`, restricted to `columns`, to `sum`.
    ///
    /// # Panics
    /// If `sum` is longer than `columns`.
    pub(crate) fn add(
        &self,
        node: u32,
        force: &Vector3<f64>,
        columns: Range<usize>,
        sum: &mut [f32],
    ) {
        let first = 3 * node as usize;
        let row = |axis: usize| &self.numbers[(first + axis) * self.width..][columns.clone()];
        let (rows, units) = ([0, 1, 2].map(row), &self.units[first..first + 3]);
        let by = std::array::from_fn(|axis| force[axis] as f32 * units[axis]);
        vectorised(
            #[inline(always)]
            || add(sum, rows, by),
        );
    }

    /// Number in `column` of the row of `node` and `axis`.
    pub(crate) fn at(&self, node: u32, axis: usize, column: usize) -> f64 {
        let row = 3 * node as usize + axis;
        f64::from(self.units[row]) * f64::from(self.numbers[row * self.width + column])
    }
}

#[inline(always)]
fn add(sum: &mut [f32], [a, b, c]: [&[i16]; 3], [x, y, z]: [f32; 3]) {
    let count = sum.len();
    let (a, b, c) = (&a[..count], &b[..count], &c[..count]);
    for i in 0..count {
        sum[i] += x * f32::from(a[i]) + y * f32::from(b[i]) + z * f32::from(c[i]);
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
            let mut sum = vec![1.0; size];
            responses.add(1, &force, 0..size, &mut sum);
            for (i, found) in sum.iter().enumerate() {
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
        let mut sum = vec![0.0; 2];
        responses.add(0, &Vector3::repeat(1.0), 1..3, &mut sum);
        assert_eq!(sum, [0.0; 2]);
    }
}
