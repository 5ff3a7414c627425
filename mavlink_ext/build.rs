//! Generates the messages of the dialect, and a table of what a frame's header does not say of them.
//!
//! The definitions are copied before they are read, because two things in them are changed, neither of which the wire
//! shows:
//! - message fields lose `enum="MAV_CMD"`. Commands are an open set (every dialect adds some), and the generated code
//!   refuses a whole message for one number it does not know; as plain integers they can be answered with "unsupported".
//! - notes of deprecation go: what peers still send must be understood, without a warning at each place that does.

use std::collections::HashSet;
use std::error::Error;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs};

use mavlink_bindgen::XmlDefinitions;
use mavlink_bindgen::parser::{MavMessage, extra_crc, parse_profile};

const DEFINITIONS: &str = "dialects";
const TOP: &str = "tandem.xml";

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-changed={DEFINITIONS}");
    println!("cargo:rerun-if-changed=build.rs");
    let out = PathBuf::from(env::var("OUT_DIR")?);
    let definitions = out.join(DEFINITIONS);
    fs::create_dir_all(&definitions)?;
    for entry in fs::read_dir(DEFINITIONS)? {
        let path = entry?.path();
        if path.extension().is_some_and(|extension| extension == "xml") {
            let name = path.file_name().ok_or("a definition without a name")?;
            let open = with_open_commands(&fs::read_to_string(&path)?);
            let undated = without_elements(&without_elements(&open, "deprecated"), "superseded");
            fs::write(definitions.join(name), undated)?;
        }
    }
    let top = XmlDefinitions::Files(vec![definitions.join(TOP)]);
    let generated = mavlink_bindgen::generate(top, &out)?;
    mavlink_bindgen::format_generated_code(&generated); // Else a compiler error shows one line of two megabytes.
    fs::write(out.join("catalogue.rs"), catalogue(&definitions)?)?;
    Ok(())
}

/// The definition with commands in message fields as plain integers.
fn with_open_commands(xml: &str) -> String {
    let mut open = String::with_capacity(xml.len());
    for line in xml.lines() {
        if line.trim_start().starts_with("<field") {
            open.push_str(&line.replace(r#" enum="MAV_CMD""#, ""));
        } else {
            open.push_str(line);
        }
        open.push('\n');
    }
    open
}

/// The definition without the elements of this name, which contain no others.
fn without_elements(xml: &str, name: &str) -> String {
    let (opening, closing) = (format!("<{name}"), format!("</{name}>"));
    let mut rest = xml;
    let mut kept = String::with_capacity(xml.len());
    while let Some(start) = rest.find(&opening) {
        kept.push_str(&rest[..start]);
        let element = &rest[start..];
        let tag = element.find('>').map_or(element.len(), |at| at + 1);
        let end = if element[..tag].ends_with("/>") {
            tag
        } else {
            element
                .find(&closing)
                .map_or(element.len(), |at| at + closing.len())
        };
        rest = &element[end..];
    }
    kept.push_str(rest);
    kept
}

/// The source text of the table, in ascending order of the ids.
fn catalogue(definitions: &Path) -> Result<String, Box<dyn Error>> {
    let profile = parse_profile(definitions, Path::new(TOP), &mut HashSet::new())?;
    let mut messages: Vec<&MavMessage> = profile.messages.values().collect();
    messages.sort_by_key(|message| message.id);
    let mut table = String::from("&[\n");
    for message in messages {
        let target_system = match message.name.as_str() {
            "MANUAL_CONTROL" => "target",
            _ => "target_system",
        };
        let size = |extensions: bool| -> usize {
            let fields = message.fields.iter();
            fields
                .filter(|field| extensions || !field.is_extension)
                .map(|field| field.mavtype.size())
                .sum()
        };
        writeln!(
            table,
            "    MessageInfo {{ id: {}, name: {:?}, crc_extra: {}, length_without_extensions: {}, length: {}, \
             target_system: {:?}, target_component: {:?} }},",
            message.id,
            message.name,
            extra_crc(message),
            size(false),
            size(true),
            offset_of(message, target_system),
            offset_of(message, "target_component"),
        )?;
    }
    table.push_str("]\n");
    Ok(table)
}

/// Where the field lies in the payload. The parser has sorted the fields into wire order.
fn offset_of(message: &MavMessage, name: &str) -> Option<usize> {
    let position = message.fields.iter().position(|field| field.name == name)?;
    let before = &message.fields[..position];
    Some(before.iter().map(|field| field.mavtype.size()).sum())
}
