//! Colours of tissues by the names of regions.

/// Words in names of regions, and the colour of the tissue; the first that occurs counts, so that
/// "fatty marrow" is marrow.
const TISSUES: [(&[&str], [f32; 3]); 17] = [
    (
        &[
            "lump",
            "tumour",
            "tumor",
            "lesion",
            "nodule",
            "inclusion",
            "cyst",
        ],
        [0.44, 0.33, 0.80],
    ),
    (&["marrow"], [0.80, 0.56, 0.44]),
    (&["cartilage"], [0.62, 0.78, 0.87]),
    (&["meniscus"], [0.90, 0.55, 0.36]),
    (&["tendon", "ligament", "fascia"], [0.90, 0.87, 0.80]),
    (&["nerve"], [0.93, 0.83, 0.45]),
    (&["vein"], [0.36, 0.44, 0.70]),
    (
        &["vessel", "artery", "aorta", "blood", "duct"],
        [0.74, 0.18, 0.16],
    ),
    (&["lung", "lobe", "airway"], [0.90, 0.66, 0.64]),
    (&["liver"], [0.58, 0.26, 0.20]),
    (&["heart", "myocard", "ventric", "atri"], [0.72, 0.28, 0.25]),
    (
        &["brain", "grey", "gray", "white matter"],
        [0.85, 0.74, 0.70],
    ),
    (&["gland", "parenchyma"], [0.90, 0.62, 0.56]),
    (&["muscle"], [0.68, 0.27, 0.23]),
    (&["fat", "adipose"], [0.95, 0.83, 0.52]),
    (&["skin", "dermis"], [0.91, 0.72, 0.60]),
    (
        &[
            "bone", "femur", "tibia", "fibula", "patella", "skull", "jaw", "rib", "vertebra",
            "metatars", "phalan", "talus",
        ],
        [0.94, 0.90, 0.80],
    ),
];

/// Returns the colour of the tissue that a region is named after, from 0 to 1; `None` for other names.
pub(crate) fn tissue_colour(name: &str) -> Option<[f32; 3]> {
    let name = name.to_lowercase();
    let of = TISSUES
        .iter()
        .find(|(words, _)| words.iter().any(|w| name.contains(w)));
    of.map(|(_, colour)| *colour)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_regions_have_the_colour_of_their_tissue() {
        let of = |name| tissue_colour(name).expect(name);
        assert_eq!(of("Femur bone"), of("tibia"));
        assert_eq!(of("medial tibial cartilage"), of("cartilage"));
        assert_ne!(of("cartilage"), of("bone"));
        // Fat is yellow, muscle red, bone light.
        let [r, g, b] = of("subcutaneous fat");
        assert!(r > g && g > 1.3 * b);
        let [r, g, _] = of("muscle");
        assert!(r > 2.0 * g);
        assert!(of("bone").iter().all(|c| *c > 0.75));
        assert_eq!(tissue_colour("region 7"), None);
    }
}
