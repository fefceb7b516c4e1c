//! The flag `--order`: the order of the finite elements.

use palpate::mesh::ElementOrder;
use palpate::{Error, Result};

/// Parses the order of the elements.
pub fn order(text: &str) -> Result<ElementOrder> {
    let number = text.parse().map_err(|_| {
        Error::Input(format!(
            "expected 1 (linear tets) or 2 (quadratic tets), got \"{text}\""
        ))
    });
    ElementOrder::from_number(number?)
}
