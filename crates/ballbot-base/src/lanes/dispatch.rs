//! Dispatch to the best instruction set of the processor at run time.
//!
//! Dispatched code is compiled once per instruction set. All of it, including closures, must be `#[inline(always)]`; a
//! function that is not inlined is compiled for the baseline instruction set.

use super::Registers;
use fearless_simd::Level;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
use fearless_simd::Simd;

/// A computation on eight robots.
pub trait Kernel {
    /// Runs the computation with the instructions of `S`.
    fn run<S: Registers>(self, simd: S);

    /// Runs the computation robot by robot, on processors without fused multiply-adds, whose emulation is slow.
    fn run_one_by_one(self);
}

/// Runs a computation on eight robots.
// Inlined; otherwise all kernels would be compiled in this module, which is one code generation unit.
#[inline]
pub fn run_eight<K: Kernel>(kernel: K) {
    run_eight_at(Level::new(), kernel);
}

/// Runs a computation on eight robots with the instructions of `level`.
#[inline]
pub fn run_eight_at<K: Kernel>(level: Level, kernel: K) {
    // Results are the same to the last bit without dispatch; debug builds skip it to save compile time.
    #[cfg(all(target_arch = "x86_64", not(debug_assertions)))]
    if let Some(simd) = level.as_avx512() {
        simd.vectorize(
            #[inline(always)]
            || kernel.run(simd),
        );
        return;
    }
    #[cfg(target_arch = "x86_64")]
    if let Some(simd) = level.as_avx2() {
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

/// Runs a computation on one robot with fused multiply-add instructions if the processor has them.
#[inline]
pub fn run_one<R>(kernel: impl FnOnce() -> R) -> R {
    #[cfg(target_arch = "x86_64")]
    if let Some(simd) = Level::new().as_avx2() {
        return simd.vectorize(kernel);
    }
    kernel()
}
