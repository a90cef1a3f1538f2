//! Names of files in the directory of the results.

/// The file of all runs.
pub const RUNS: &str = "runs.jsonl";

/// The tables.
pub const TABLES: [&str; 5] = ["table.md", "table.csv", "shapes.csv", "surface.csv", "table.tex"];
