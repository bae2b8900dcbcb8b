//! As a C header.

use super::{OwnTopic, constant_name, constants, doc_of};
use fss_messages::{Definition, Field, Scalar};
use std::fmt::Write;

const HEAD: &str = "#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
#define FSS_ASSERT static_assert
#else
#define FSS_ASSERT _Static_assert
#endif
";

/// The header of these messages and topics.
pub(super) fn render(definitions: &[Definition], topics: &[OwnTopic]) -> String {
    let guard = if topics.is_empty() {
        definitions.iter().map(|d| format!("{}_{}_H", d.package, d.name).to_uppercase()).next().unwrap_or_default()
    } else {
        "FSS_MESSAGES_H".to_owned()
    };
    let mut text = format!("/* Made by `fss messages --c`; do not change it. */\n#ifndef {guard}\n#define {guard}\n\n");
    text.push_str(HEAD);
    for definition in definitions {
        message(&mut text, definition);
    }
    for topic in topics {
        let name = constant_name(topic.name);
        let _ = write!(text, "\n/* {} */\n", topic.doc);
        let _ = writeln!(text, "#define FSS_{name} fss_msgs__{}__AT(\"{}\")", topic.message, topic.name);
    }
    text.push_str("\n#endif\n");
    text
}

fn message(text: &mut String, definition: &Definition) {
    let name = format!("{}__{}", definition.package, definition.name);
    let _ = write!(text, "\n/* {} */\ntypedef struct {{\n", doc_of(definition));
    for field in &definition.fields {
        let _ = writeln!(text, "    {}; /* {} */", declaration(field), field.doc);
    }
    let _ = writeln!(text, "}} {name};");
    for constant in constants(definition) {
        let _ = writeln!(text, "#define {name}__{} {} /* {} */", constant.name, constant.value, constant.doc);
    }
    let _ = writeln!(text, "FSS_ASSERT(sizeof({name}) == {}, \"size of {name}\");", definition.size);
    for field in &definition.fields {
        let (field, offset) = (&field.name, field.offset);
        let _ = writeln!(text, "FSS_ASSERT(offsetof({name}, {field}) == {offset}, \"{name}.{field}\");");
    }
    let lines: Vec<String> = definition.text.lines().map(|line| format!("    \"{}\\n\"", escaped(line))).collect();
    let _ = writeln!(text, "#define {name}__DEFINITION \\\n{}", lines.join(" \\\n"));
    let schema = definition.schema();
    let _ = writeln!(text, "#define {name}__AT(topic) {{ topic, \"{schema}\", {name}__DEFINITION, sizeof({name}) }}");
}

fn declaration(field: &Field<String>) -> String {
    let kind = match field.scalar {
        Scalar::U8 => "uint8_t",
        Scalar::U16 => "uint16_t",
        Scalar::U32 => "uint32_t",
        Scalar::U64 => "uint64_t",
        Scalar::I64 => "int64_t",
        Scalar::F64 => "double",
    };
    let array = field.count.map_or_else(String::new, |count| format!("[{count}]"));
    format!("{kind} {}{array}", field.name)
}

fn escaped(line: &str) -> String {
    line.replace('\\', "\\\\").replace('"', "\\\"")
}
