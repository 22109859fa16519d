//! Parts of the library by themselves; most are not part of its interface.

mod active_set;
mod clock;
mod common_lyapunov;
mod contact;
mod dual;
mod flops;
mod interrupt;
mod lanes;
mod levels;
mod memory;
#[cfg(feature = "render")]
mod mesh;
mod normal;
mod philox;
mod snapshot;
