//! Tables hold, for every program that reads them, what the log holds.
#![allow(clippy::unwrap_used)]

use fss_messages::{Event, Header, NavState, Sample, topic};
use fss_records::log::{Log, LogWriter};
use fss_records::table::{CsvFile, MatlabFile, ParquetFile, Table, TableError, TableFile};
use parquet::file::reader::SerializedFileReader;
use parquet::record::Field;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

const ROWS: u64 = 10;
const WORDS: &str = "it says \"a, b\"; 0.1 µm";

fn nav(i: u64) -> NavState {
    // Numbers that no short decimal is: a table that rounds would show.
    let x_m = (i as f64 * 0.1).sin();
    let mut sample = NavState { x_m, std: [x_m, 1.0, 0.0, -0.0, 1e-300, 2.0, 3.0], ..NavState::default() };
    sample.set_header(Header { sequence: i + 1, stamp_ns: u64::MAX - i, published_ns: i });
    sample
}

fn log(folder: &Path) -> Log {
    let path = folder.join("run.mcap");
    let mut log = LogWriter::create(&path).unwrap();
    let states = log.add_topic::<NavState>(topic::NAV_STATE.name).unwrap();
    let events = log.add_topic::<Event>(topic::EVENTS.name).unwrap();
    for i in 0..ROWS {
        log.write(states, &nav(i)).unwrap();
    }
    log.write(events, &Event::new(5, "arm", Event::WARNING, format_args!("{WORDS}"))).unwrap();
    log.finish().unwrap();
    Log::open(&path).unwrap()
}

/// Writes a topic in parts of three rows.
fn write<F: TableFile>(log: &Log, topic: &str, path: &Path) -> PathBuf {
    let mut file: Option<F> = None;
    let each = |table: &Table| -> Result<(), TableError> {
        assert!(table.rows() <= 3);
        let mut open = file.take().map_or_else(|| F::create(path, table), Ok)?;
        open.append(table)?;
        file = Some(open);
        Ok(())
    };
    log.tables(topic, 3, each).unwrap();
    file.unwrap().finish().unwrap();
    path.to_owned()
}

#[test]
fn parquet_holds_every_value_to_the_last_bit() {
    let folder = tempfile::tempdir().unwrap();
    let log = log(folder.path());
    let rows = |topic| {
        let path = write::<ParquetFile>(&log, topic, &folder.path().join("table.parquet"));
        SerializedFileReader::new(File::open(path).unwrap())
            .unwrap()
            .into_iter()
            .map(Result::unwrap)
            .collect::<Vec<_>>()
    };
    let states = rows("/nav/state");
    assert_eq!(states.len() as u64, ROWS);
    for (row, i) in states.iter().zip(0..) {
        let value = |name: &str| row.get_column_iter().find(|(own, _)| *own == name).unwrap().1.clone();
        assert_eq!(value("x_m"), Field::Double(nav(i).x_m));
        assert_eq!(value("stamp_ns"), Field::ULong(u64::MAX - i));
        assert_eq!([value("std.0"), value("std.5")], [Field::Double(nav(i).x_m), Field::Double(2.0)]);
    }
    let event = &rows("/events")[0];
    let names: Vec<_> = event.get_column_iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["sequence", "stamp_ns", "published_ns", "service", "text", "severity"], "and no padding");
    assert!(event.get_column_iter().any(|(_, value)| *value == Field::Str(WORDS.to_owned())));
}

#[test]
fn csv_gives_back_the_same_bits_and_text() {
    let folder = tempfile::tempdir().unwrap();
    let log = log(folder.path());
    let read = |topic| {
        let path = write::<CsvFile>(&log, topic, &folder.path().join("table.csv"));
        let mut reader = csv::Reader::from_path(path).unwrap();
        let header = reader.headers().unwrap().clone();
        (header, reader.records().map(Result::unwrap).collect::<Vec<_>>())
    };
    let (header, rows) = read("/nav/state");
    let column = header.iter().position(|name| name == "std.0").unwrap();
    let values: Vec<f64> = rows.iter().map(|row| row[column].parse().unwrap()).collect();
    assert_eq!(values, (0..ROWS).map(|i| nav(i).x_m).collect::<Vec<_>>());
    assert!(read("/events").1[0].iter().any(|value| value == WORDS));
}

/// A data element of a MATLAB file: its type, its bytes, and what follows.
fn element(bytes: &[u8]) -> (u32, &[u8], &[u8]) {
    let word = |at: usize| u32::from_le_bytes(*bytes[at..].first_chunk().unwrap());
    if word(0) >> 16 != 0 {
        // A small one: type and size in four bytes, value in the next four.
        return (word(0) & 0xffff, &bytes[4..4 + (word(0) >> 16) as usize], &bytes[8..]);
    }
    let size = word(4) as usize;
    (word(0), &bytes[8..8 + size], &bytes[8 + size.next_multiple_of(8)..])
}

/// Class, dimensions, name, and what follows of an array.
fn array(bytes: &[u8]) -> (u8, [i32; 2], String, &[u8]) {
    let (_, flags, rest) = element(bytes);
    let (_, dimensions, rest) = element(rest);
    let (_, name, rest) = element(rest);
    let size = |at: usize| i32::from_le_bytes(*dimensions[at..].first_chunk().unwrap());
    (flags[0], [size(0), size(4)], String::from_utf8(name.to_vec()).unwrap(), rest)
}

/// The fields of a struct: name, class, dimensions, data.
fn fields(bytes: &[u8]) -> Vec<(String, u8, [i32; 2], &[u8])> {
    let (_, len, rest) = element(bytes);
    let len = u32::from_le_bytes(*len.first_chunk().unwrap()) as usize;
    let (_, names, mut rest) = element(rest);
    let mut fields = Vec::new();
    for name in names.chunks(len) {
        let (kind, content, next) = element(rest);
        assert_eq!(kind, 14, "a field is an array");
        let (class, dimensions, _, data) = array(content);
        let name = String::from_utf8(name.to_vec()).unwrap().trim_end_matches('\0').to_owned();
        fields.push((name, class, dimensions, data));
        rest = next;
    }
    assert!(rest.is_empty());
    fields
}

#[test]
fn matlab_gets_a_struct_with_matrices_column_by_column() {
    let folder = tempfile::tempdir().unwrap();
    let log = log(folder.path());
    let path = folder.path().join("run.mat");
    let mut file = MatlabFile::create(&path).unwrap();
    for (topic, name) in [("/nav/state", "nav.state"), ("/events", "events")] {
        log.tables(topic, usize::MAX, |table| file.append(name, table)).unwrap();
    }
    file.finish().unwrap();
    let bytes = fs::read(path).unwrap();
    assert_eq!(bytes[124..128], [0, 1, b'I', b'M'], "version 1, little endian");

    let (_, nav_state, rest) = element(&bytes[128..]);
    let (class, dimensions, name, content) = array(nav_state);
    assert_eq!((class, dimensions, name.as_str()), (2, [1, 1], "nav_state"));
    let fields_of_nav = fields(content);
    let field = |name: &str| fields_of_nav.iter().find(|(own, ..)| own == name).unwrap();
    let (_, class, dimensions, data) = field("std");
    assert_eq!((*class, *dimensions), (6, [ROWS as i32, 7]), "a matrix of doubles");
    let doubles: Vec<f64> = element(data).1.as_chunks().0.iter().map(|word| f64::from_le_bytes(*word)).collect();
    assert_eq!(doubles[..ROWS as usize], (0..ROWS).map(|i| nav(i).x_m).collect::<Vec<_>>());
    assert_eq!(doubles[ROWS as usize..2 * ROWS as usize], [1.0; ROWS as usize]);
    let (_, class, _, data) = field("stamp_ns");
    assert_eq!(*class, 15, "times stay whole numbers");
    assert_eq!(element(data).1[..8], u64::MAX.to_le_bytes());

    let (_, events, rest) = element(rest);
    assert!(rest.is_empty());
    let events = fields(array(events).3);
    let (_, class, dimensions, cell) = events.iter().find(|(name, ..)| name == "text").unwrap();
    assert_eq!((*class, *dimensions), (1, [1, 1]), "text is a cell array");
    let (class, _, _, data) = array(element(cell).1);
    let units: Vec<u16> = element(data).1.as_chunks().0.iter().map(|unit| u16::from_le_bytes(*unit)).collect();
    assert_eq!((class, String::from_utf16(&units).unwrap()), (4, WORDS.to_owned()));
}
