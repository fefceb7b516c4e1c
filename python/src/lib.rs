//! Native module `palpate._palpate` of the Python package `palpate`.
//!
//! It handles numpy arrays and scenes as JSON. The public Python interface (names, defaults, types
//! of other libraries) is in `palpate/*.py`; each class there wraps one of these.

mod arrays;
mod body;
mod devices;
mod errors;
mod gradients;
mod identify;
mod mesh;
mod pieces;
mod press;
mod scenes;
mod stage;
mod volume;
mod work;

use pyo3::prelude::*;

#[pymodule]
fn _palpate(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<mesh::Mesh>()?;
    module.add_class::<volume::Volume>()?;
    module.add_class::<stage::Stage>()?;
    module.add_class::<stage::Grab>()?;
    module.add_class::<pieces::Intervals>()?;
    module.add_class::<press::Press>()?;
    module.add_class::<press::PressMap>()?;
    module.add_function(wrap_pyfunction!(devices::adapters, module)?)?;
    module.add_function(wrap_pyfunction!(devices::device_memory, module)?)?;
    module.add_function(wrap_pyfunction!(gradients::gradient, module)?)?;
    module.add_function(wrap_pyfunction!(gradients::gradient_of_motion, module)?)?;
    module.add_function(wrap_pyfunction!(gradients::use_double_precision, module)?)?;
    module.add_function(wrap_pyfunction!(identify::identify, module)?)?;
    module.add_function(wrap_pyfunction!(mesh::load_mesh, module)?)?;
    module.add_function(wrap_pyfunction!(mesh::generators, module)?)?;
    module.add_function(wrap_pyfunction!(pieces::count_pieces, module)?)?;
    module.add_function(wrap_pyfunction!(pieces::write_pieces, module)?)?;
    module.add_function(wrap_pyfunction!(scenes::read_toml, module)?)?;
    module.add_function(wrap_pyfunction!(scenes::to_toml, module)?)?;
    module.add_function(wrap_pyfunction!(scenes::read_series, module)?)?;
    module.add_function(wrap_pyfunction!(scenes::presets, module)?)?;
    module.add_function(wrap_pyfunction!(work::write_png, module)?)?;
    module.add_function(wrap_pyfunction!(work::jpeg, module)?)?;
    module.add_function(wrap_pyfunction!(work::warp, module)?)?;
    module.add_function(wrap_pyfunction!(work::tune, module)?)?;
    module.add_function(wrap_pyfunction!(work::study, module)?)?;
    module.add_function(wrap_pyfunction!(work::studies, module)?)?;
    Ok(())
}
