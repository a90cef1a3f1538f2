//! What a training step asks the system for, once it has warmed up.
#![allow(unsafe_code)]

use bijective_sdf::geometry::AnalyticShape;
use bijective_sdf::reconstruct::{Config, Phase, Stage, Trainer};
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

/// Sizes from which the C library maps fresh pages for each request, which then fault one by one.
const LARGE: usize = 128 << 10;

static LARGE_REQUESTS: AtomicUsize = AtomicUsize::new(0);
static BYTES: AtomicUsize = AtomicUsize::new(0);

struct Counting;

// SAFETY: everything is left to the system's allocator; counting touches no memory of it.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        BYTES.fetch_add(layout.size(), Relaxed);
        LARGE_REQUESTS.fetch_add(usize::from(layout.size() >= LARGE), Relaxed);
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Large requests and bytes so far.
fn asked() -> (usize, usize) {
    (LARGE_REQUESTS.load(Relaxed), BYTES.load(Relaxed))
}

/// The buffers of a step hold some 50 MB; what it computes them in is kept from step to step. What remains are the
/// gradients that are handed out, index lists of the neighbours, and, where the band is searched for anew, its grid. On
/// one thread: others warm up whenever they first get work.
#[test]
fn a_warm_step_asks_for_little() {
    rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(warm_steps);
}

fn warm_steps() {
    let (points, _) = AnalyticShape::Torus { major: 0.36, minor: 0.14 }.sample(300, 1);
    let mut config = Config::default();
    (config.start.steps, config.bsp_pretrain) = (100, 6);
    // Two steps of a run look at the whole surface as it would be in the end; they are none of those meant here.
    config.weights.bridge = 0.0;
    let (refresh, cold) = (config.band.refresh, 12);
    config.stages = vec![Stage { resolution: 32, steps: cold + 24 }];
    let mut trainer = Trainer::new(&points, &config).unwrap();
    let (mut warm, mut first) = (Vec::new(), None);
    let mut step_in_phase = 0;
    while !trainer.is_done() {
        let (phase, before) = (trainer.phase(), asked());
        trainer.step().unwrap();
        let after = asked();
        let used = (after.0 - before.0, after.1 - before.1);
        if phase == Phase::Train {
            first.get_or_insert(used);
            if step_in_phase >= cold {
                warm.push((step_in_phase % refresh == 0, used));
            }
            step_in_phase += 1;
        }
    }
    assert_eq!(warm.len(), 24);
    assert!(first.unwrap().1 > 30 << 20, "the first step fills the buffers: {first:?}");
    for (refreshes, (large, bytes)) in warm {
        // Measured: 18 requests and 12.7 MB with a search for the band; up to 5 and 2.8 MB without.
        let (most_large, most_bytes) = if refreshes { (36, 24 << 20) } else { (10, 6 << 20) };
        assert!(large <= most_large && bytes <= most_bytes, "{large} large requests, {bytes} bytes");
    }
}
