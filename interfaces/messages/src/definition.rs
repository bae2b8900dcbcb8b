//! A message's definition as a value: of one that another program, or a log, brings along.

use crate::schema::{field_hash, is_cdr_layout, name_hash};
use crate::{Field, Sample, Scalar};

/// The first three fields of every message, as a definition says them.
const HEADER: [&str; 3] = ["sequence", "stamp_ns", "published_ns"];

/// What a message's ROS 2 definition says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Definition {
    /// Its ROS 2 package.
    pub package: String,
    /// Its name, without the package.
    pub name: String,
    /// The definition (`.msg` text).
    pub text: String,
    /// Its fields in order, the header's first.
    pub fields: Vec<Field<String>>,
    /// Size of a sample, bytes.
    pub size: usize,
    /// As [`Sample::HASH`].
    pub hash: u64,
}

/// Why a message's definition is refused.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DefinitionError {
    /// The line, counted from 1.
    pub line: usize,
    /// What is wrong, and what to do.
    pub message: String,
}

impl core::fmt::Display for DefinitionError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "line {}: {}", self.line, self.message)
    }
}

impl core::error::Error for DefinitionError {}

impl Definition {
    /// Of a type of this program.
    pub fn of<T: Sample>() -> Self {
        let owned = |f: &Field| Field {
            name: f.name.to_owned(),
            doc: f.doc.to_owned(),
            scalar: f.scalar,
            count: f.count,
            offset: f.offset,
        };
        Self {
            package: T::PACKAGE.to_owned(),
            name: T::NAME.to_owned(),
            text: T::definition(),
            fields: T::FIELDS.iter().map(owned).collect(),
            size: size_of::<T>(),
            hash: T::HASH,
        }
    }

    /// Reads the definition of `package/msg/Name`.
    ///
    /// # Errors
    /// Says which line is no field of a plain sample.
    pub fn parse(schema: &str, text: &str) -> Result<Self, DefinitionError> {
        let refused = |line: usize, message: String| DefinitionError { line, message };
        let (package, name) = schema
            .split_once("/msg/")
            .filter(|(package, name)| is_word(package) && is_word(name))
            .ok_or_else(|| refused(1, format!("'{schema}' is no name of a message; it reads package/msg/Name")))?;
        let mut fields: Vec<Field<String>> = Vec::new();
        let mut size = 0;
        for (number, line) in (1..).zip(text.lines()) {
            let (said, doc) = line.split_once('#').unwrap_or((line, ""));
            // A constant has a value.
            if said.trim().is_empty() || said.contains('=') {
                continue;
            }
            let field = parse_field(said, doc.trim(), size).map_err(|message| refused(number, message))?;
            size += field.size();
            fields.push(field);
            if !is_cdr_layout(&fields, size) {
                let help = "order the fields by size, 8 bytes first, and fill with reserved bytes";
                return Err(refused(number, format!("this field would stand behind a gap: {help}")));
            }
        }
        let has_header = HEADER.iter().zip(&fields).all(|(name, field)| field.name == *name && field.is_time());
        if !has_header || fields.len() < HEADER.len() || !size.is_multiple_of(8) {
            let help = "a message begins with uint64 sequence, stamp_ns and published_ns, and is filled to 8 bytes";
            return Err(refused(1, help.to_owned()));
        }
        let add = |hash, field: &Field<String>| field_hash(hash, &field.name, field.scalar, field.count);
        let hash = fields.iter().fold(name_hash(name), add);
        let (package, name, text) = (package.to_owned(), name.to_owned(), text.to_owned());
        Ok(Self { package, name, text, fields, size, hash })
    }

    /// Its full name as logs have it: `package/msg/Name`.
    pub fn schema(&self) -> String {
        format!("{}/msg/{}", self.package, self.name)
    }

    /// As [`Sample::TYPE_NAME`].
    pub fn type_name(&self) -> String {
        format!("{}/{}@{:016x}", self.package, self.name, self.hash)
    }
}

impl Field<String> {
    fn is_time(&self) -> bool {
        self.scalar == Scalar::U64 && self.count.is_none()
    }
}

/// Reads `type name` or `type[N] name`.
fn parse_field(said: &str, doc: &str, offset: usize) -> Result<Field<String>, String> {
    let mut words = said.split_whitespace();
    let (Some(kind), Some(name), None) = (words.next(), words.next(), words.next()) else {
        return Err(format!("'{}' is no field; a field reads `float64 torque_nm` or `float64[4] q_rad`", said.trim()));
    };
    let (kind, count) = match kind.split_once('[') {
        Some((kind, count)) => {
            let count =
                count.strip_suffix(']').and_then(|n| n.parse::<usize>().ok()).filter(|n| (1..=4096).contains(n));
            (kind, Some(count.ok_or_else(|| format!("{name}: an array has a fixed length of 1 to 4096"))?))
        }
        None => (kind, None),
    };
    let known = [Scalar::U8, Scalar::U16, Scalar::U32, Scalar::U64, Scalar::I64, Scalar::F64];
    let scalar = known.into_iter().find(|scalar| scalar.ros_name() == kind).ok_or_else(|| {
        let names = known.map(Scalar::ros_name).join(", ");
        format!("'{kind}' is no type of a plain sample; these are {names}, and arrays of them")
    })?;
    if !is_word(name) {
        return Err(format!("'{name}' is no name of a field"));
    }
    Ok(Field { name: name.to_owned(), doc: doc.to_owned(), scalar, count, offset })
}

fn is_word(name: &str) -> bool {
    !name.is_empty() && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_')
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{SampleVisitor, visit_samples};

    #[test]
    fn a_definition_that_was_written_reads_as_the_type_itself() {
        struct Check(usize);
        impl SampleVisitor for Check {
            fn visit<T: Sample>(&mut self) {
                let of_type = Definition::of::<T>();
                assert_eq!(of_type.type_name(), T::TYPE_NAME);
                assert_eq!(Definition::parse(&of_type.schema(), &of_type.text), Ok(of_type));
                self.0 += 1;
            }
        }
        let mut check = Check(0);
        visit_samples(&mut check);
        assert!(check.0 > 10);
    }

    #[test]
    fn what_is_no_plain_sample_is_refused_with_its_line() {
        let header = "uint64 sequence\nuint64 stamp_ns\nuint64 published_ns\n";
        let refusal = |text: &str| Definition::parse("a_msgs/msg/A", &format!("{header}{text}")).map_err(|e| e.line);
        assert!(refusal("float64[3] x_m # position\nuint8 A=1\nuint8[8] b").is_ok());
        for bad in ["string name", "float64[] x", "float64 a b", "uint8 a\nfloat64 b", "uint8 a-b"] {
            let line = if bad.contains('\n') { 5 } else { 4 };
            assert_eq!(refusal(bad).map(|d| d.size), Err(line), "{bad}");
        }
        assert_eq!(refusal("uint8 a").map(|d| d.size), Err(1), "not filled to 8 bytes");
        assert!(Definition::parse("a_msgs/msg/A", "float64 x").is_err(), "no header");
    }
}
