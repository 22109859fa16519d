//! Memory checks before use: a failed allocation ends the process.

use crate::error::{Error, Result};
use std::fmt;

/// A number of bytes, in words.
struct Bytes(u64);

impl fmt::Display for Bytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            small if small < 1_000_000 => write!(f, "{small} bytes"),
            medium if medium < 1_000_000_000 => write!(f, "{:.0} MB", medium as f64 / 1e6),
            large => write!(f, "{:.1} GB", large as f64 / 1e9),
        }
    }
}

/// Required bytes below which there is no check.
const SMALL: u64 = 16 << 20;

/// Checks whether `items` of `bytes` each can be allocated; the message starts with `what` they are for.
///
/// # Errors
/// [`Error::Memory`] with the required and the available amount.
pub fn require_memory(what: impl fmt::Display, items: usize, bytes: usize) -> Result<()> {
    let need = (items as u64).saturating_mul(bytes as u64);
    if need < SMALL {
        return Ok(());
    }
    if let Some(free) = available()
        && need > free
    {
        return Err(out_of_memory(what, need, format!("{} are available", Bytes(free))));
    }
    // Amounts that the system would reject, for example by a process limit.
    let reserved = usize::try_from(need).map(|need| Vec::<u8>::new().try_reserve_exact(need));
    if !matches!(reserved, Ok(Ok(()))) {
        return Err(out_of_memory(what, need, NOT_GIVEN.to_owned()));
    }
    Ok(())
}

const NOT_GIVEN: &str = "the system does not give that much to this process";

fn out_of_memory(what: impl fmt::Display, need: u64, limit: String) -> Error {
    Error::Memory { what: what.to_string(), need: format!("about {}", Bytes(need)), limit }
}

/// Zeros, if there is memory for them.
///
/// # Errors
/// As [`require_memory`].
pub fn try_zeros<T: Clone + Default>(what: impl fmt::Display, shape: &[usize]) -> Result<Vec<T>> {
    let len = shape.iter().fold(1_usize, |len, &n| len.saturating_mul(n));
    require_memory(what, len, size_of::<T>())?;
    Ok(vec![T::default(); len])
}

/// Reserves space for `len` more items, if there is memory for them.
///
/// # Errors
/// As [`require_memory`].
pub fn try_reserve<T>(what: impl fmt::Display, items: &mut Vec<T>, len: usize) -> Result<()> {
    if items.capacity() - items.len() >= len {
        return Ok(());
    }
    require_memory(&what, len, size_of::<T>())?;
    items.try_reserve_exact(len).map_err(|_| out_of_memory(&what, (len * size_of::<T>()) as u64, NOT_GIVEN.to_owned()))
}

/// Memory available without swapping, if the system reports it: the minimum of machine and container.
fn available() -> Option<u64> {
    let read = |path: &str| std::fs::read_to_string(path).ok();
    let machine = read("/proc/meminfo").and_then(|text| {
        let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
        line.split_whitespace().next()?.parse::<u64>().ok()?.checked_mul(1024)
    });
    let number = |path: &str| read(path)?.trim().parse::<u64>().ok();
    let container = number("/sys/fs/cgroup/memory.max")
        .zip(number("/sys/fs/cgroup/memory.current"))
        .map(|(limit, used)| limit.saturating_sub(used));
    machine.into_iter().chain(container).min()
}
