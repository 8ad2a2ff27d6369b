//! Measures of the feel.

pub mod force_table;
