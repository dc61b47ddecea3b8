//! Arrays of NumPy: those that own their numbers, and those that look at numbers of a file.

use chpm_mesh::{Scalar, scalar_places, scalar_words};
use numpy::{Element, IntoPyArray, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Arc;

/// An array of the shape (n, N) that takes the numbers over.
pub(crate) fn rows<T: Element, const N: usize>(
    py: Python<'_>,
    rows: Vec<[T; N]>,
) -> PyResult<Py<PyArray2<T>>> {
    let count = rows.len();
    Ok(rows.into_flattened().into_pyarray(py).reshape([count, N])?.unbind())
}

/// An array of the shape (n,) that takes the numbers over.
pub(crate) fn row<T: Element>(py: Python<'_>, row: Vec<T>) -> Py<PyArray1<T>> {
    row.into_pyarray(py).unbind()
}

/// A number that an array can look at.
pub(crate) trait Number {
    /// Byte order, kind and length, as NumPy writes them.
    const CODE: &'static str;
}

impl Number for f32 {
    const CODE: &'static str = "<f4";
}

impl Number for u32 {
    const CODE: &'static str = "<u4";
}

impl Number for u16 {
    const CODE: &'static str = "<u2";
}

impl Number for u8 {
    const CODE: &'static str = "|u1";
}

/// Numbers of a file, as an array that cannot be written: NumPy takes the address and keeps this object, and so the file's map.
#[pyclass(frozen, module = "chpm")]
pub(crate) struct Look {
    /// What has the numbers; they stay where they are as long as it lives.
    _kept: Arc<dyn Send + Sync>,
    address: usize,
    shape: Vec<usize>,
    code: &'static str,
}

#[pymethods]
impl Look {
    /// What NumPy asks for: where the numbers are, and that they are read only.
    #[getter]
    fn __array_interface__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let told = PyDict::new(py);
        told.set_item("version", 3)?;
        told.set_item("typestr", self.code)?;
        told.set_item("shape", pyo3::types::PyTuple::new(py, &self.shape)?)?;
        told.set_item("data", (self.address, true))?;
        Ok(told)
    }
}

/// An array of the shape (n,) that looks at numbers which `kept` has.
pub(crate) fn look<T: Number>(
    py: Python<'_>,
    kept: &Arc<impl Send + Sync + 'static>,
    numbers: &[T],
) -> PyResult<Py<PyAny>> {
    looked(py, kept, numbers, vec![numbers.len()])
}

/// An array of the shape (n, N) that looks at numbers which `kept` has.
pub(crate) fn look_rows<T: Number, const N: usize>(
    py: Python<'_>,
    kept: &Arc<impl Send + Sync + 'static>,
    numbers: &[[T; N]],
) -> PyResult<Py<PyAny>> {
    looked(py, kept, numbers.as_flattened(), vec![numbers.len(), N])
}

fn looked<T: Number>(
    py: Python<'_>,
    kept: &Arc<impl Send + Sync + 'static>,
    numbers: &[T],
    shape: Vec<usize>,
) -> PyResult<Py<PyAny>> {
    let address = numbers.as_ptr().expose_provenance();
    let look = Look { _kept: kept.clone(), address, shape, code: T::CODE };
    Ok(py.import("numpy")?.call_method1("asarray", (look,))?.unbind())
}

/// Arrays of named scalars, by their names. `words` has those of each vertex in a row.
pub(crate) fn values(py: Python<'_>, scalars: &[Scalar], words: &[u32]) -> PyResult<Py<PyDict>> {
    let each = scalar_words(scalars).max(1);
    let arrays = PyDict::new(py);
    for (place, Scalar { name, kind, .. }) in scalar_places(scalars) {
        let own = words.chunks_exact(each).map(|row| &row[place.clone()]);
        match kind.words() {
            // The bits themselves, whatever they are.
            1 => arrays
                .set_item(name, row(py, own.map(|words| f32::from_bits(words[0])).collect::<Vec<_>>()))?,
            _ => arrays.set_item(name, row(py, own.map(|words| kind.value(words)).collect::<Vec<_>>()))?,
        }
    }
    Ok(arrays.unbind())
}
