//! XYZ and CSV, and the guess of the format from the content.
#![no_main]

mod check;

use bijective_sdf::io::{Columns, Format, ReadOptions};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    check::cloud(bytes, Some(Format::Xyz));
    for (delimiter, skip) in [(Some(b'\t'), 0), (Some(b' '), 1), (Some(b';'), 2)] {
        let columns = Some(Columns::Numbers([2, 1, 3]));
        let mut options = ReadOptions::default();
        (options.format, options.columns) = (Some(Format::Xyz), columns);
        (options.delimiter, options.skip) = (delimiter, skip);
        check::cloud_with(bytes, &options);
    }
    check::cloud(bytes, None);
    check::mesh(bytes, None);
});
