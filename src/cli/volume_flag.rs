//! The flag `--volume` of commands that render and simulate: a formulation of the material, or the
//! number of one of several volumes in a scan.

use palpate::physics::VolumetricFormulation;
use palpate::{Error, Result};
use std::str::FromStr;

/// A volumetric formulation, or the number of one of several volumes in a file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum VolumeFlag {
    Formulation(VolumetricFormulation),
    Number(usize),
}

impl FromStr for VolumeFlag {
    type Err = Error;

    fn from_str(text: &str) -> Result<VolumeFlag> {
        match text.parse() {
            Ok(number) => Ok(VolumeFlag::Number(number)),
            Err(_) => text.parse().map(VolumeFlag::Formulation),
        }
    }
}

/// Returns the formulation among the `given`, if there is one.
pub fn formulation(given: &[VolumeFlag]) -> Option<VolumetricFormulation> {
    given.iter().find_map(|flag| match flag {
        VolumeFlag::Formulation(formulation) => Some(*formulation),
        VolumeFlag::Number(_) => None,
    })
}

/// Returns the number among the `given`, if there is one.
pub fn number(given: &[VolumeFlag]) -> Option<usize> {
    given.iter().find_map(|flag| match flag {
        VolumeFlag::Number(number) => Some(*number),
        VolumeFlag::Formulation(_) => None,
    })
}
