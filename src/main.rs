//! The program `bijective-sdf`.

fn main() {}
