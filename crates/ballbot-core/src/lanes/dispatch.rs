//! The best instructions that the processor has, chosen at run time.
//!
//! What runs here is compiled once for each kind of processor; all of it must be `#[inline(always)]`, closures too, or it
//! is compiled for the plainest.

use fearless_simd::{Level, Simd};

/// A computation on eight robots.
pub trait Kernel {
    /// Runs it with the instructions of `S`.
    fn run<S: Simd>(self, simd: S);

    /// Runs it robot by robot: on processors without fused multiply-adds, which would have to be emulated in every lane.
    fn run_one_by_one(self);
}

/// Runs a computation on eight robots.
pub fn run_eight<K: Kernel>(kernel: K) {
    let level = Level::new();
    #[cfg(target_arch = "x86_64")]
    if let Some(simd) = level.as_avx512() {
        simd.vectorize(
            #[inline(always)]
            || kernel.run(simd),
        );
    } else if let Some(simd) = level.as_avx2() {
        simd.vectorize(
            #[inline(always)]
            || kernel.run(simd),
        );
    } else {
        kernel.run_one_by_one();
    }
    #[cfg(target_arch = "aarch64")]
    if let Some(simd) = level.as_neon() {
        simd.vectorize(
            #[inline(always)]
            || kernel.run(simd),
        );
    } else {
        kernel.run_one_by_one();
    }
    #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
    {
        let _ = level;
        kernel.run_one_by_one();
    }
}

/// Runs a computation on one robot where fused multiply-adds are instructions, if the processor has them.
pub fn run_one<R>(kernel: impl FnOnce() -> R) -> R {
    #[cfg(target_arch = "x86_64")]
    if let Some(simd) = Level::new().as_avx2() {
        return simd.vectorize(kernel);
    }
    kernel()
}
