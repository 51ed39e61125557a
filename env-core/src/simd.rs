//! Loops compiled for the processor that runs them.

#![allow(clippy::inline_always)] // What is not inlined is not compiled for the processor.

use std::sync::LazyLock;

use pulp::{Arch, NullaryFnOnce, Simd, WithSimd};

/// This processor, asked once: a short loop takes less time than the question.
static ARCH: LazyLock<Arch> = LazyLock::new(Arch::new);

/// Runs `kernel` with the wide vectors of this processor.
///
/// Only what is inlined into it is compiled for them: the closure itself and all that its loops call
/// must be `#[inline(always)]`.
#[inline(always)]
pub(crate) fn vectorised<R>(kernel: impl FnMut() -> R) -> R {
    ARCH.dispatch(Kernel(kernel))
}

/// A closure that is called where it stands. Handed over bare, `pulp` would call it by way of
/// `FnOnce::call_once`, which is compiled apart and for the oldest processor.
struct Kernel<F>(F);

impl<R, F: FnMut() -> R> NullaryFnOnce for Kernel<F> {
    type Output = R;

    #[inline(always)]
    fn call(mut self) -> R {
        (self.0)()
    }
}

/// Adds x a + y b + z c to `sum`, for `rows` a, b, c of its length.
///
/// # Panics
/// If a row is shorter or longer.
pub(crate) fn add_rows(sum: &mut [f32], rows: [&[f32]; 3], [x, y, z]: [f32; 3]) {
    assert!(rows.iter().all(|row| row.len() == sum.len()), "rows are as long as their sum");
    ARCH.dispatch(AddRows { sum, rows, by: [x, y, z] });
}

struct AddRows<'a> {
    sum: &'a mut [f32],
    rows: [&'a [f32]; 3],
    by: [f32; 3],
}

impl WithSimd for AddRows<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let [x, y, z] = self.by.map(|x| simd.splat_f32s(x));
        let (sums, rest) = S::as_mut_simd_f32s(self.sum);
        let [(a, a_rest), (b, b_rest), (c, c_rest)] = self.rows.map(S::as_simd_f32s);
        let add = |sum: S::f32s, [a, b, c]: [S::f32s; 3]| {
            let more = simd.mul_add_e_f32s(y, b, simd.mul_add_e_f32s(x, a, sum));
            simd.mul_add_e_f32s(z, c, more)
        };
        for (((sum, &a), &b), &c) in sums.iter_mut().zip(a).zip(b).zip(c) {
            *sum = add(*sum, [a, b, c]);
        }
        let last = [a_rest, b_rest, c_rest].map(|row| simd.partial_load_f32s(row));
        simd.partial_store_f32s(rest, add(simd.partial_load_f32s(rest), last));
    }
}

/// Σ `term`(a, b), in an order that a processor can take several steps of at once.
#[inline(always)]
pub(crate) fn sum(a: &[f32], b: &[f32], term: impl Fn(f32, f32) -> f32) -> f32 {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<16>(), b.as_chunks::<16>());
    let mut sums = [0.0; 16];
    for (a, b) in a.iter().zip(b) {
        for i in 0..16 {
            sums[i] += term(a[i], b[i]);
        }
    }
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(&a, &b)| term(a, b)).sum();
    sums.iter().sum::<f32>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_added_whatever_their_length() {
        for size in [0, 1, 15, 16, 17, 675] {
            let row = |k: usize| (0..size).map(|i| ((7 * i + k) % 11) as f32).collect::<Vec<_>>();
            let (mut sum, [a, b, c]) = (row(3), [row(0), row(1), row(2)]);
            let expected: Vec<f32> =
                (0..size).map(|i| sum[i] + 2.0 * a[i] - 3.0 * b[i] + 0.5 * c[i]).collect();
            add_rows(&mut sum, [&a, &b, &c], [2.0, -3.0, 0.5]);
            assert_eq!(sum, expected, "{size} numbers");
        }
    }
}
