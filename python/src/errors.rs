//! Conversion of library errors into the exception classes of `palpate/_errors.py`, with the
//! library's messages.

use palpate::Error;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::io::ErrorKind;

/// Returns the Python exception for an error.
pub fn to_py_err(py: Python<'_>, error: Error) -> PyErr {
    let class = match &error {
        Error::Io { source, .. } if source.kind() == ErrorKind::NotFound => "MissingFileError",
        Error::Io { .. } | Error::Format { .. } => "FileError",
        Error::Mesh(_) | Error::Input(_) => "InputError",
        Error::NoAdapter(_) | Error::Gpu(_) | Error::DeviceLost(_) => "DeviceError",
        Error::Solver { .. } => "SolverError",
        _ => "Error",
    };
    made(py, class, &error).unwrap_or_else(|_| PyRuntimeError::new_err(error.to_string()))
}

fn made(py: Python<'_>, class: &str, error: &Error) -> PyResult<PyErr> {
    let class = py.import("palpate._errors")?.getattr(class)?;
    let more = PyDict::new(py);
    if let Error::Solver {
        solver, step, time, ..
    } = error
    {
        more.set_item("solver", solver)?;
        more.set_item("step", step)?;
        more.set_item("time", time)?;
    }
    Ok(PyErr::from_value(
        class.call((error.to_string(),), Some(&more))?,
    ))
}

/// Returns the exception for an invalid argument.
pub fn input_error(py: Python<'_>, what: impl Into<String>) -> PyErr {
    to_py_err(py, Error::Input(what.into()))
}

/// Conversion of library results into Python results.
pub trait Raise<T> {
    /// Converts the error into a Python exception.
    fn or_raise(self, py: Python<'_>) -> PyResult<T>;
}

impl<T> Raise<T> for palpate::Result<T> {
    fn or_raise(self, py: Python<'_>) -> PyResult<T> {
        self.map_err(|error| to_py_err(py, error))
    }
}
