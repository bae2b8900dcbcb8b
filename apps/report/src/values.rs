//! A sample of any topic as a line of text, by its own definition.

use fss_messages::Definition;
use std::fmt::Write as _;

/// Values of a sample that are told.
const VALUES: usize = 6;
/// Behind the header, which every message has.
const HEADER_FIELDS: usize = 3;

/// The first values of a sample with their names: `speed_m_s 0.0123 valid 1`.
pub(crate) fn line(definition: &Definition, sample: &[u8]) -> String {
    let fields = definition.fields.iter().skip(HEADER_FIELDS).filter(|field| !field.is_padding() && !field.is_text());
    let values = fields.flat_map(|field| (0..field.count.unwrap_or(1)).map(move |i| (field, i)));
    let mut line = String::new();
    for (field, i) in values.take(VALUES) {
        let Some(value) = field.number(i, sample) else { continue };
        let index = field.count.map_or_else(String::new, |_| format!(".{i}"));
        let gap = if line.is_empty() { "" } else { " " };
        let digits = if value == value.round() && value.abs() < 1e15 { 0 } else { 4 };
        // Writing into a string does not fail.
        let _ = write!(line, "{gap}{}{index} {value:.digits$}", field.name);
    }
    line
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_line_names_the_first_values_and_leaves_out_what_only_fills() {
        let text = "uint64 sequence\nuint64 stamp_ns\nuint64 published_ns\nfloat64[2] q_rad\nuint8 valid\nuint8[7] reserved0\n";
        let definition = Definition::parse("a_msgs/msg/A", text).unwrap();
        let mut sample = vec![0; definition.size];
        sample[24..32].copy_from_slice(&0.25_f64.to_le_bytes());
        sample[40] = 1;
        assert_eq!(line(&definition, &sample), "q_rad.0 0.2500 q_rad.1 0 valid 1");
    }
}
