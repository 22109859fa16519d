//! Chunks of a batch in pieces, one per thread task.

use super::buffers::StepBuffers;
use super::env::chunk::Chunk;

/// `per_piece` chunks of `width` environments at a time, with their part of the buffers.
pub(super) fn pieces<'a>(
    chunks: &'a mut [Box<dyn Chunk>],
    per_piece: usize,
    width: usize,
    buffers: StepBuffers<'a>,
) -> impl Iterator<Item = (&'a mut [Box<dyn Chunk>], StepBuffers<'a>)> {
    let mut rest = Some(buffers);
    chunks.chunks_mut(per_piece).map(move |piece| {
        let (share, others) = rest.take().expect("put back below").split(piece.len() * width);
        rest = Some(others);
        (piece, share)
    })
}
