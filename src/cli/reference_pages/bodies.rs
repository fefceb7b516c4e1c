//! Page of the generated bodies and of the tissues.

use super::GENERATED;
use palpate::generate::GENERATORS;
use palpate::physics::TISSUES;

/// Returns the page.
pub fn of_bodies() -> (String, String) {
    let mut page = format!(
        "# Generated bodies and tissues\n\n{GENERATED}\n## Generators\n\n\
         `generate` in [`[mesh]`](scene/mesh.md): bodies without a file, with their default number of tets.\n\n\
         | name | body |\n| --- | --- |\n"
    );
    for (name, text) in GENERATORS {
        page += &format!("| `{name}` | {text} |\n");
    }
    page += "\n## Tissues\n\nPublished values of tissues, which a name in [`[material]`](scene/material.md) stands for. \
             Values differ between persons by factors of two to ten.\n\n\
             | tissue | Young's modulus, Pa | Poisson's ratio | density, kg/m³ | source of the modulus |\n\
             | --- | --- | --- | --- | --- |\n";
    for tissue in &TISSUES {
        page += &format!(
            "| `{}` | {:e} | {} | {} | {} |\n",
            tissue.name, tissue.young, tissue.poisson, tissue.density, tissue.source
        );
    }
    ("bodies.md".to_owned(), page)
}
