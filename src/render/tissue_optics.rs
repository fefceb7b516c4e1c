//! Colours of tissues from their measured scattering and absorption.
//!
//! - Reduced scattering μs' = a (λ/500 nm)^−b: mean values of classes of tissues, table 2 of Jacques 2013,
//!   "Optical properties of biological tissues: a review", Phys. Med. Biol. 58, R37.
//! - Absorption: blood of 150 g/l haemoglobin (molar extinction compiled by Prahl, Oregon Medical Laser
//!   Center) in a fraction of the volume, at an oxygen saturation, both in the range of table 3 there;
//!   what remains is that of bloodless skin, μa = 0.244 + 85.3 exp(−(λ − 154 nm)/66.2 nm) per cm (Jacques
//!   1998); fat has carotene besides, skin an epidermis with melanosomes.
//! - Colour: the diffuse reflectance of a half-space of matched index in diffusion theory (Flock et al.
//!   1989, IEEE Trans. Biomed. Eng. 36, 1162) at 620, 540 and 460 nm.

/// Wavelengths of red, green and blue, nm.
const WAVELENGTHS: [f64; 3] = [620.0, 540.0, 460.0];
/// Molar extinction of haemoglobin with and without oxygen at these wavelengths, 1/(cm M).
const OXYGENATED: [f64; 3] = [942.0, 53236.0, 44480.0];
const DEOXYGENATED: [f64; 3] = [6509.6, 46592.0, 23388.8];
/// Absorption per molar extinction of whole blood: ln 10 · 150 g/l over 64,500 g/mol.
const BLOOD: f64 = 2.303 * 150.0 / 64_500.0;
/// Thickness of the epidermis, cm.
const EPIDERMIS: f64 = 0.006;
/// Extinction per extent of the mesh of a tissue that attenuates 1/cm.
const EXTINCTION: f64 = 0.8;

/// Optical properties of a tissue.
struct Tissue {
    name: &'static str,
    /// a (1/cm) and b of the reduced scattering.
    scattering: [f64; 2],
    /// Fraction of the volume that is blood, and its oxygen saturation.
    blood: [f64; 2],
    /// Further absorption at the blue wavelength, 1/cm, and the fraction of melanosomes.
    carotene: f64,
    melanosomes: f64,
}

const SOFT: [f64; 2] = [18.9, 1.286];

const TISSUES: [Tissue; 7] = [
    tissue("optical_skin", [46.0, 1.421], [0.002, 0.75], 0.0, 0.012),
    tissue("optical_fat", [18.4, 0.672], [0.002, 0.75], 1.5, 0.0),
    tissue("optical_muscle", SOFT, [0.05, 0.70], 0.0, 0.0),
    tissue("optical_cartilage", [27.1, 1.627], [0.0, 0.0], 0.0, 0.0),
    tissue("optical_bone", [22.9, 0.716], [0.001, 0.75], 0.0, 0.0),
    tissue("optical_vessel", SOFT, [1.0, 0.97], 0.0, 0.0),
    tissue("optical_lung", SOFT, [0.01, 0.85], 0.0, 0.0),
];

const fn tissue(
    name: &'static str,
    scattering: [f64; 2],
    blood: [f64; 2],
    carotene: f64,
    melanosomes: f64,
) -> Tissue {
    Tissue {
        name,
        scattering,
        blood,
        carotene,
        melanosomes,
    }
}

impl Tissue {
    /// Returns reduced scattering and absorption at a wavelength, 1/cm.
    fn coefficients(&self, k: usize) -> [f64; 2] {
        let [a, b] = self.scattering;
        let [fraction, saturation] = self.blood;
        let extinction = saturation * OXYGENATED[k] + (1.0 - saturation) * DEOXYGENATED[k];
        let bloodless = 0.244 + 85.3 * (-(WAVELENGTHS[k] - 154.0) / 66.2).exp();
        let carotene = if k == 2 { self.carotene } else { 0.0 };
        let absorption = fraction * BLOOD * extinction + bloodless + carotene;
        [a * (WAVELENGTHS[k] / 500.0).powf(-b), absorption]
    }

    /// Returns the diffuse reflectance at a wavelength.
    fn reflectance(&self, k: usize) -> f64 {
        let [scattering, absorption] = self.coefficients(k);
        let albedo = scattering / (scattering + absorption);
        let root = (3.0 * (1.0 - albedo)).sqrt();
        let below = albedo / (1.0 + 2.0 * (1.0 - albedo) + (5.0 / 3.0) * root);
        // Through the epidermis and back; melanosomes absorb 6.6·10¹¹ λ^−3.33 per cm (Jacques 1998).
        let melanin = self.melanosomes * 6.6e11 * WAVELENGTHS[k].powf(-3.33);
        below * (-2.0 * melanin * EPIDERMIS).exp()
    }
}

/// Returns the names of the tissues.
pub(super) fn names() -> impl Iterator<Item = &'static str> {
    TISSUES.iter().map(|tissue| tissue.name)
}

/// Returns the colour of a tissue as displayed, from 0 to 1, and its extinction per extent of a mesh, which
/// is proportional to its attenuation of green light; `None` for other names.
pub(super) fn look(name: &str) -> Option<([f64; 3], f64)> {
    let tissue = TISSUES.iter().find(|tissue| tissue.name == name)?;
    let colour = [0, 1, 2].map(|k| tissue.reflectance(k).powf(1.0 / 2.2));
    let [scattering, absorption] = tissue.coefficients(1);
    Some((colour, EXTINCTION * (scattering + absorption)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tissues_have_the_colours_of_their_blood_and_scattering() {
        let of = |name: &str| look(&format!("optical_{name}")).expect(name);
        for name in names() {
            let (colour, extinction) = look(name).expect(name);
            assert!(
                colour.iter().all(|c| (0.05..0.95).contains(c)),
                "{name} {colour:?}"
            );
            assert!((2.0..400.0).contains(&extinction), "{name} {extinction}");
        }
        let red = |name: &str| of(name).0[0] / of(name).0[1];
        // The more blood, the redder; cartilage has none.
        assert!(red("vessel") > red("muscle") && red("muscle") > red("lung"));
        assert!(red("lung") > red("skin") && red("cartilage") < 1.1);
        // Carotene makes fat yellow.
        let [_, green, blue] = of("fat").0;
        assert!(green > 1.1 * blue);
        assert!(look("skin").is_none());
    }
}
