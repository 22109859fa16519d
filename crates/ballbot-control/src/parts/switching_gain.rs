//! The gain of a sliding mode, fixed or adapted.

use ballbot_base::lanes::{Lane, Memory};

/// η + η̂, the rate at which a surface S is reached outside a boundary layer. η̂ grows outside the layer (Plestan,
/// Shtessel, Brégeault and Poznyak, Int. J. Control 83(9), 2010) and leaks (Ioannou and Kokotovic, Automatica 20(5),
/// 1984): dη̂/dt = γ max(0, |S| − φ) − σ η̂, limited to its maximum; initially zero.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SwitchingGain {
    /// η.
    fixed: f64,
    /// e^(−σ T) for a sample, and the increase of η̂ per distance. `None` if η̂ stays zero.
    adapted: Option<[f64; 2]>,
    /// Largest η̂.
    most: f64,
}

impl SwitchingGain {
    /// A gain from `fixed` to `largest`, with γ = `adaptation` and σ = `leakage`, sampled every `dt` seconds.
    pub(crate) fn new([fixed, largest]: [f64; 2], adaptation: f64, leakage: f64, dt: f64) -> Self {
        let left = (-leakage * dt).exp();
        // ∫ e^(−σ t) dt over a sample.
        let held = if leakage > 0.0 { (1.0 - left) / leakage } else { dt };
        let adapted = (adaptation > 0.0).then_some([left, adaptation * held]);
        Self { fixed, adapted, most: (largest - fixed).max(0.0) }
    }

    /// The gain without adaptation.
    pub(crate) fn fixed(&self) -> f64 {
        self.fixed
    }

    /// The largest gain.
    pub(crate) fn largest(&self) -> f64 {
        self.fixed + if self.adapted.is_some() { self.most } else { 0.0 }
    }

    /// Number of stored values per robot.
    pub(crate) fn kept(&self) -> usize {
        usize::from(self.adapted.is_some())
    }

    /// The present gain.
    #[inline(always)]
    pub(crate) fn now<L: Lane>(&self, like: L, memory: &Memory<'_, L>) -> L {
        let fixed = like.splat(self.fixed);
        if self.adapted.is_some() { memory.get(0) + fixed } else { fixed }
    }

    /// Adapts the gain to a sample at distance `distance` from the layer. Limited torques, of which the fraction
    /// `share` is left, do not raise it: they cannot act.
    #[inline(always)]
    pub(crate) fn adapt<L: Lane>(&self, distance: L, share: L, memory: &mut Memory<'_, L>) {
        let Some([left, added]) = self.adapted else { return };
        let zero = distance.zero();
        let counted = L::select(share.lt(share.splat(1.0)), zero, distance.max(zero));
        let next = (memory.get(0) * left + counted * added).min(zero.splat(self.most));
        memory.set(0, next);
    }
}
