//! As a Python module.

use super::{OwnTopic, constant_name, constants, doc_of};
use fss_messages::{Definition, Field, Scalar};
use std::fmt::Write;

/// The module of these messages and topics.
pub(super) fn render(definitions: &[Definition], topics: &[OwnTopic]) -> String {
    let mut text =
        "# Made by `fss messages --python`; do not change it.\n\"\"\"Messages as ctypes structures.\"\"\"\n\n\
        import ctypes\n"
            .to_owned();
    for definition in definitions {
        message(&mut text, definition);
    }
    if !topics.is_empty() {
        text.push('\n');
    }
    for topic in topics {
        let _ = writeln!(text, "\n#: {}", topic.doc);
        let _ = writeln!(text, "{} = (\"{}\", {})", constant_name(topic.name), topic.name, topic.message);
    }
    text
}

fn message(text: &mut String, definition: &Definition) {
    let _ = write!(text, "\n\nclass {}(ctypes.Structure):\n", definition.name);
    let _ = write!(text, "    \"\"\"{}\"\"\"\n\n", doc_of(definition).replace('"', "'"));
    for constant in constants(definition) {
        let _ = writeln!(text, "    {} = {}  # {}", constant.name, constant.value, constant.doc);
    }
    text.push_str("    _fields_ = [\n");
    for field in &definition.fields {
        let _ = writeln!(text, "        (\"{}\", {}),  # {}", field.name, kind(field), field.doc);
    }
    let _ = writeln!(text, "    ]\n    SCHEMA = \"{}\"", definition.schema());
    let lines: Vec<String> = definition.text.lines().map(|line| format!("        {:?}", format!("{line}\n"))).collect();
    let _ = writeln!(text, "    DEFINITION = (\n{}\n    )", lines.join("\n"));
    let _ = write!(text, "\n    @staticmethod\n    def type_name():\n        return \"{}\"\n", definition.type_name());
}

fn kind(field: &Field<String>) -> String {
    let kind = match field.scalar {
        Scalar::U8 => "ctypes.c_uint8",
        Scalar::U16 => "ctypes.c_uint16",
        Scalar::U32 => "ctypes.c_uint32",
        Scalar::U64 => "ctypes.c_uint64",
        Scalar::I64 => "ctypes.c_int64",
        Scalar::F64 => "ctypes.c_double",
    };
    field.count.map_or_else(|| kind.to_owned(), |count| format!("{kind} * {count}"))
}
