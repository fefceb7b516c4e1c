//! Published stiffnesses and densities of biological tissues.

use crate::{Error, Result};

/// Material parameters of a tissue, from the literature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tissue {
    /// Its name in scenes.
    pub name: &'static str,
    /// Young's modulus at small strain, Pa.
    pub young: f64,
    /// Density, kg/m³: ICRU Report 46 (1992), *Photon, electron, proton and neutron interaction
    /// data for body tissues*; tendon, ligament and meniscus after Mast, *Empirical relationships
    /// between acoustic parameters in human soft tissues* (2000).
    pub density: f64,
    /// Poisson's ratio. Soft tissue is mostly water and nearly incompressible: published models use
    /// 0.45 to 0.4999, of which 0.45 is used here, because linear tets lock as it nears ½. Bone has
    /// 0.3, as is usual in finite element models; the meniscus after Danso et al., J. Biomech.
    /// (2018), the lung after the source of its modulus.
    pub poisson: f64,
    /// Source of the modulus, and the measuring method.
    pub source: &'static str,
}

/// The tissues known by name. Published values of one tissue differ by factors of two to ten with
/// method, strain and subject: these are single reputable measurements, meant as starting points.
pub const TISSUES: [Tissue; 14] = [
    tissue(
        "bone",
        17e9,
        0.3,
        1920.0,
        "compact bone, human femur, lengthwise: Reilly & Burstein, J. Biomech. 8:393 (1975)",
    ),
    tissue(
        "cancellous-bone",
        2.9e8,
        0.3,
        1180.0,
        "human vertebra, compression: Kopperdahl & Keaveny, J. Biomech. 31:601 (1998)",
    ),
    tissue(
        "cartilage",
        6e5,
        0.45,
        1100.0,
        "human femoral condyle, aggregate modulus: Athanasiou et al., J. Orthop. Res. 9:330 (1991)",
    ),
    tissue(
        "meniscus",
        4.1e5,
        0.32,
        1100.0,
        "bovine, aggregate modulus: Proctor et al., J. Orthop. Res. 7:771 (1989)",
    ),
    tissue(
        "tendon",
        1.2e9,
        0.45,
        1130.0,
        "human tibialis anterior, in vivo: Maganaris & Paul, J. Physiol. 521:307 (1999)",
    ),
    tissue(
        "ligament",
        3.3e8,
        0.45,
        1130.0,
        "human medial collateral, lengthwise: Quapp & Weiss, J. Biomech. Eng. 120:757 (1998)",
    ),
    tissue(
        "skin",
        1.3e5,
        0.45,
        1090.0,
        "human forearm, suction: Diridollou et al., Skin Res. Technol. 6:214 (2000)",
    ),
    tissue(
        "fat",
        3.3e3,
        0.45,
        950.0,
        "human breast, indentation: Samani et al., Phys. Med. Biol. 52:1565 (2007)",
    ),
    tissue(
        "gland",
        3.2e3,
        0.45,
        1020.0,
        "human breast, fibroglandular, indentation: Samani et al., Phys. Med. Biol. 52:1565 (2007)",
    ),
    tissue(
        "muscle",
        1.2e4,
        0.45,
        1050.0,
        "mouse, at rest, crosswise: Engler et al., J. Cell Biol. 166:877 (2004)",
    ),
    tissue(
        "heart",
        1.8e4,
        0.45,
        1060.0,
        "rat myocardium, indentation: Berry et al., Am. J. Physiol. Heart 290:H2196 (2006)",
    ),
    tissue(
        "liver",
        6e3,
        0.45,
        1060.0,
        "human, in vivo, three times the shear modulus: Rouvière et al., Radiology 240:440 (2006)",
    ),
    tissue(
        "lung",
        2e3,
        0.42,
        260.0,
        "dog lobe inflated by 1 kPa: Lai-Fook et al., J. Appl. Physiol. 40:508 (1976)",
    ),
    tissue(
        "brain",
        1.9e3,
        0.45,
        1040.0,
        "bovine white matter, indentation: Budday et al., J. Mech. Behav. Biomed. 46:318 (2015)",
    ),
];

const fn tissue(
    name: &'static str,
    young: f64,
    poisson: f64,
    density: f64,
    source: &'static str,
) -> Tissue {
    Tissue {
        name,
        young,
        poisson,
        density,
        source,
    }
}

impl Tissue {
    /// The tissue with this name.
    ///
    /// # Errors
    /// [`Error::Input`] that lists the names if `name` is unknown.
    pub fn by_name(name: &str) -> Result<Tissue> {
        let found = TISSUES.iter().find(|t| t.name == name);
        found.copied().ok_or_else(|| {
            let names: Vec<&str> = TISSUES.iter().map(|t| t.name).collect();
            Error::Input(format!(
                "unknown tissue \"{name}\"; expected one of {}",
                names.join(", ")
            ))
        })
    }
}
