//! Numeric loops compiled for the widest vector instructions of the processor that runs them.

#![allow(clippy::inline_always)] // Code that is not inlined is not compiled for the processor.

use std::sync::LazyLock;

use pulp::{Arch, NullaryFnOnce};

/// Numbers that a kernel processes at once: as many as the widest vectors hold.
pub(crate) const LANES: usize = 16;

/// Vector instructions of this processor, detected once: the detection takes longer than a short
/// loop.
static ARCH: LazyLock<Arch> = LazyLock::new(Arch::new);

/// Runs `kernel` with the widest vectors of this processor.
///
/// Only inlined code is compiled for them: the closure itself and all functions that its loops call
/// must be `#[inline(always)]`.
#[inline(always)]
pub(crate) fn vectorised<R>(kernel: impl FnMut() -> R) -> R {
    ARCH.dispatch(Kernel(kernel))
}

/// A wrapper with which `pulp` inlines a closure. A bare closure would be called by way of
/// `FnOnce::call_once`, which is compiled separately and for the oldest processor.
struct Kernel<F>(F);

impl<R, F: FnMut() -> R> NullaryFnOnce for Kernel<F> {
    type Output = R;

    #[inline(always)]
    fn call(mut self) -> R {
        (self.0)()
    }
}

/// Returns Σ `term`(a, b), as [`LANES`] partial sums that the processor can compute at once.
#[inline(always)]
pub(crate) fn sum(a: &[f32], b: &[f32], term: impl Fn(f32, f32) -> f32) -> f32 {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    let mut sums = [0.0; LANES];
    for (a, b) in a.iter().zip(b) {
        for i in 0..LANES {
            sums[i] += term(a[i], b[i]);
        }
    }
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(&a, &b)| term(a, b)).sum();
    sums.iter().sum::<f32>() + rest
}

/// Length of the shortest pieces of rows: as many numbers as the vectors of most processors hold.
pub(crate) const PIECE: usize = LANES / 2;

/// Adds x a + y b + z c to `sum`, whose length is that of the three rows and a multiple of
/// [`PIECE`].
///
/// A loop over all numbers: one over parts of [`LANES`] is unrolled and not converted to vectors.
#[inline(always)]
pub(crate) fn add_rows(sum: &mut [f32], [a, b, c]: [&[i16]; 3], [x, y, z]: [f32; 3]) {
    let count = sum.len() / PIECE * PIECE;
    let (sum, a, b, c) = (&mut sum[..count], &a[..count], &b[..count], &c[..count]);
    for i in 0..count {
        sum[i] += x * f32::from(a[i]) + y * f32::from(b[i]) + z * f32::from(c[i]);
    }
}
