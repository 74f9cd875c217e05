//! Arrays in large pages. Rays jump about a tree of many megabytes; with pages of 4 KiB most of those jumps also miss the
//! processor's table of pages. The system is asked for pages of 2 MiB and may decline: nothing but speed depends on it.

use rayon::prelude::*;

/// Smaller arrays are left alone.
const LARGE: usize = 4 << 20;

/// Everything an iterator of known length gives, in order, in large pages where it is much.
pub(super) fn collect<T: Send>(items: impl IndexedParallelIterator<Item = T>) -> Vec<T> {
    let mut all = Vec::with_capacity(items.len());
    advise(&mut all);
    all.par_extend(items);
    all
}

/// Ask for large pages for what a vector has room for but does not hold yet.
#[cfg(target_os = "linux")]
pub(super) fn advise<T>(room: &mut Vec<T>) {
    const PAGE: usize = 4096;
    let room = room.spare_capacity_mut();
    let bytes = size_of_val(room);
    if bytes < LARGE {
        return;
    }
    let start = room.as_mut_ptr().cast::<std::ffi::c_void>();
    let skip = start.align_offset(PAGE);
    let whole = (bytes - skip) / PAGE * PAGE;
    // SAFETY: the pages lie in memory that this vector owns, and the advice leaves what they hold as it is.
    // Declined advice is no fault.
    let _ = unsafe { rustix::mm::madvise(start.wrapping_byte_add(skip), whole, rustix::mm::Advice::LinuxHugepage) };
}

/// Other systems are not asked.
#[cfg(not(target_os = "linux"))]
pub(super) fn advise<T>(_: &mut Vec<T>) {}
