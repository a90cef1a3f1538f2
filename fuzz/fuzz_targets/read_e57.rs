#![no_main]

mod check;

use bijective_sdf::io::Format;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    check::cloud(bytes, Some(Format::E57));
});
