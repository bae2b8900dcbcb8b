//! Logs: what they hold, and the samples of topics as bytes that NumPy looks at in place.

use crate::error::from_error;
use fss_messages::{Definition, Field, Scalar};
use fss_records::log::{Layout, Log, LogError, Selection};
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread;

/// Blocks that may be ready before they are wanted.
const BLOCKS_AHEAD: usize = 1;

/// A field: name, NumPy type, offset in bytes, meaning.
pub(crate) type FieldTuple = (String, String, usize, String);
/// A topic's samples: fields, bytes of a sample, the samples.
type Selected<'py> = (Vec<FieldTuple>, usize, Bound<'py, PyArray1<u8>>);

/// A log on disk.
#[pyclass(frozen, module = "fss")]
pub(crate) struct LogFile {
    path: PathBuf,
}

impl LogFile {
    fn open(&self) -> Result<Log, LogError> {
        Log::open(&self.path)
    }
}

#[pymethods]
impl LogFile {
    #[new]
    fn new(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        py.detach(|| Log::open(&path).map(|_| ())).map_err(|e| from_error(&e))?;
        Ok(Self { path })
    }

    /// Topics, times, attachments, metadata, completeness and damage.
    fn contents<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let contents = py.detach(|| self.open()?.contents()).map_err(|e| from_error(&e))?;
        let topics = PyDict::new(py);
        for (name, topic) in &contents.topics {
            topics.set_item(
                name,
                (&topic.schema, &topic.definition, topic.count, fields_of(&topic.schema, &topic.definition)),
            )?;
        }
        let attachments = PyDict::new(py);
        for (name, data) in &contents.attachments {
            attachments.set_item(name, PyBytes::new(py, data))?;
        }
        let damage = (contents.damage.places, contents.damage.bytes, contents.damage.cut_off_bytes);
        let all = PyDict::new(py);
        all.set_item("topics", topics)?;
        all.set_item("first_ns", contents.first_ns)?;
        all.set_item("last_ns", contents.last_ns)?;
        all.set_item("attachments", attachments)?;
        all.set_item("metadata", contents.metadata)?;
        all.set_item("is_complete", contents.is_complete)?;
        all.set_item("damage", damage)?;
        Ok(all)
    }

    /// The samples of topics with a log time in a range, in one pass: these fields of them, or all where there are none.
    fn select<'py>(
        &self,
        py: Python<'py>,
        topics: Vec<String>,
        fields: Vec<String>,
        from_ns: u64,
        to_ns: u64,
    ) -> PyResult<Vec<Option<Selected<'py>>>> {
        let selected = py.detach(|| {
            let mut found: Vec<Option<(Layout, Vec<u8>)>> = topics.iter().map(|_| None).collect();
            let take = |topic: usize, layout: &Layout, bytes| {
                found[topic] = Some((layout.clone(), bytes));
                true
            };
            let selection = Selection { topics, fields, log_time_ns: from_ns..=to_ns, most_rows: usize::MAX };
            self.open()?.select(&selection, take)?;
            Ok::<_, LogError>(found)
        });
        let selected = selected.map_err(|e| from_error(&e))?;
        Ok(selected.into_iter().map(|of| of.map(|(layout, bytes)| selected_of(py, &layout, bytes))).collect())
    }

    /// A topic's samples in blocks of at most so many rows: these fields of them, or all where there are none.
    fn blocks(&self, topic: String, fields: Vec<String>, rows: usize, from_ns: u64, to_ns: u64) -> PyResult<Blocks> {
        let log = self.open().map_err(|e| from_error(&e))?;
        let (hand, receiver) = sync_channel(BLOCKS_AHEAD);
        thread::spawn(move || {
            let give = |_: usize, layout: &Layout, bytes| hand.send(Ok((layout.clone(), bytes))).is_ok();
            let selection = Selection { topics: vec![topic], fields, log_time_ns: from_ns..=to_ns, most_rows: rows };
            if let Err(e) = log.select(&selection, give) {
                // Nobody may be there to hear it.
                let _ = hand.send(Err(e));
            }
        });
        Ok(Blocks { receiver: Mutex::new(Some(receiver)) })
    }
}

type Given = Result<(Layout, Vec<u8>), LogError>;

/// An iterator over blocks of samples. The file is read ahead by a block; who stops early ends the reading.
#[pyclass(frozen, module = "fss")]
pub(crate) struct Blocks {
    receiver: Mutex<Option<Receiver<Given>>>,
}

#[pymethods]
impl Blocks {
    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __next__<'py>(&self, py: Python<'py>) -> PyResult<Option<Selected<'py>>> {
        let given = py.detach(|| {
            let receiver = self.receiver.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            receiver.as_ref().and_then(|receiver| receiver.recv().ok())
        });
        match given {
            Some(Ok((layout, bytes))) => Ok(Some(selected_of(py, &layout, bytes))),
            Some(Err(e)) => Err(from_error(&e)),
            None => Ok(None),
        }
    }

    fn close(&self) {
        *self.receiver.lock().unwrap_or_else(std::sync::PoisonError::into_inner) = None;
    }
}

fn selected_of<'py>(py: Python<'py>, layout: &Layout, bytes: Vec<u8>) -> Selected<'py> {
    (fields(&layout.fields), layout.size, PyArray1::from_vec(py, bytes))
}

/// The fields of a topic, where its schema is one of plain samples.
fn fields_of(schema: &str, definition: &str) -> Option<Vec<FieldTuple>> {
    Definition::parse(schema, definition).ok().map(|definition| fields(&definition.fields))
}

pub(crate) fn fields(fields: &[Field<String>]) -> Vec<FieldTuple> {
    let named = fields.iter().filter(|field| !field.is_padding());
    let each = named.map(|field| {
        let scalar = match field.scalar {
            Scalar::U8 => "u1",
            Scalar::U16 => "<u2",
            Scalar::U32 => "<u4",
            Scalar::U64 => "<u8",
            Scalar::I64 => "<i8",
            Scalar::F64 => "<f8",
        };
        let kind = match field.count {
            Some(count) if field.is_text() => format!("S{count}"),
            Some(count) => format!("({count},){scalar}"),
            None => scalar.to_owned(),
        };
        (field.name.clone(), kind, field.offset, field.doc.clone())
    });
    each.collect()
}
