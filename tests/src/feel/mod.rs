//! The force loop on the bench: cases, measures, and what peers do.

pub mod force_table;
pub mod tick;
