//! Loops compiled for the processor that runs them.

#![allow(clippy::inline_always)] // What is not inlined is not compiled for the processor.

use pulp::{Arch, NullaryFnOnce};

/// Runs `kernel` with the widest vectors of this processor.
///
/// Only what is inlined into it is compiled for them: the closure itself and all that its loops call
/// must be `#[inline(always)]`.
#[inline(always)]
pub(crate) fn vectorised<R>(kernel: impl FnMut() -> R) -> R {
    Arch::new().dispatch(Kernel(kernel))
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
