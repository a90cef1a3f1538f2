#![no_main]

mod check;

use bijective_sdf::io::{Format, ReadOptions};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    check::cloud(bytes, Some(Format::Raw));
    for raw in ["f32x3", "f32x5", "f64x3"] {
        let raw = Some(raw.parse().expect("rows of a raw file"));
        let mut options = ReadOptions::default();
        (options.format, options.raw) = (Some(Format::Raw), raw);
        check::cloud_with(bytes, &options);
    }
});
