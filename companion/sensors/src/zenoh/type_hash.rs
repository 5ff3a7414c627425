//! The hash by which ROS 2 tells whether two nodes mean the same by a message's name.
//!
//! ```text
//! RIHS01_ + hex(SHA-256(JSON of the type's fields and of those of every type within, in order of their names))
//! ```
//!
//! The JSON is written as Python's `json.dumps` does, with a blank after each comma and colon. Names and types of fields
//! count; comments, constants and default values do not.
//!
//! - REP-2016, *ROS 2 Interface Type Descriptions*, "Type Version Hash"; the numbers of the types are those of
//!   `type_description_interfaces/msg/FieldType`.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use sha2::{Digest as _, Sha256};

use crate::ros::Schema;

/// `FieldType`'s distances from a type to arrays, bounded and unbounded sequences of it.
const ARRAY: u8 = 48;
const BOUNDED_SEQUENCE: u8 = 96;
const UNBOUNDED_SEQUENCE: u8 = 144;

const NESTED: u8 = 1;
const UINT8: u8 = 3;
const STRING: u8 = 17;
/// From a string to a string of bounded length.
const BOUNDED_STRING: u8 = 4;

/// Blocks of a definition are divided by lines of these.
const RULE: &str = "========";

/// The hash as it stands in key expressions; an error says which line of the definition is not understood.
pub(super) fn type_hash(schema: &Schema) -> Result<String, String> {
    let types = definitions(schema)?;
    let mut within = BTreeSet::new();
    let mut to_visit = vec![schema.name.to_owned()];
    while let Some(name) = to_visit.pop() {
        let fields = types
            .get(&name)
            .ok_or_else(|| format!("{name} is not defined in it"))?;
        for nested in fields.iter().map(|field| &field.nested) {
            if !nested.is_empty() && within.insert(nested.clone()) {
                to_visit.push(nested.clone());
            }
        }
    }
    let described: Vec<String> = within.iter().map(|n| description(n, &types[n])).collect();
    let json = format!(
        "{{\"type_description\": {}, \"referenced_type_descriptions\": [{}]}}",
        description(schema.name, &types[schema.name]),
        described.join(", ")
    );
    let mut hash = "RIHS01_".to_owned();
    for byte in Sha256::digest(json) {
        // Writing to a string cannot fail.
        let _written = write!(hash, "{byte:02x}");
    }
    Ok(hash)
}

struct Field {
    name: String,
    id: u8,
    /// Length of an array, bound of a sequence.
    capacity: usize,
    /// Bound of a string.
    string_capacity: usize,
    /// The type's name if it is a message itself.
    nested: String,
}

fn description(name: &str, fields: &[Field]) -> String {
    let fields: Vec<String> = fields.iter().map(Field::description).collect();
    format!(
        "{{\"type_name\": \"{name}\", \"fields\": [{}]}}",
        fields.join(", ")
    )
}

impl Field {
    fn description(&self) -> String {
        let Self {
            name,
            id,
            capacity,
            string_capacity,
            nested,
        } = self;
        format!(
            "{{\"name\": \"{name}\", \"type\": {{\"type_id\": {id}, \"capacity\": {capacity}, \
             \"string_capacity\": {string_capacity}, \"nested_type_name\": \"{nested}\"}}}}"
        )
    }

    /// One line of a definition, of a message in this package.
    fn parse(kind: &str, name: &str, package: &str) -> Option<Self> {
        let (element, brackets) = match kind.split_once('[') {
            Some((element, rest)) => (element, Some(rest.strip_suffix(']')?)),
            None => (kind, None),
        };
        let (distance, capacity) = match brackets {
            None => (0, 0),
            Some("") => (UNBOUNDED_SEQUENCE, 0),
            Some(length) => match length.strip_prefix("<=") {
                Some(bound) => (BOUNDED_SEQUENCE, bound.parse().ok()?),
                None => (ARRAY, length.parse().ok()?),
            },
        };
        let (element, string_capacity) = match element.split_once("<=") {
            Some((element, bound)) => (element, bound.parse().ok()?),
            None => (element, 0),
        };
        let id = primitive(element);
        let is_string = id.is_some_and(|id| id == STRING || id == STRING + 1);
        if !is_identifier(name) || (string_capacity > 0 && !is_string) {
            return None;
        }
        let nested = if id.is_some() {
            String::new()
        } else {
            nested_name(element, package)?
        };
        let bounded = if string_capacity > 0 {
            BOUNDED_STRING
        } else {
            0
        };
        Some(Self {
            name: name.to_owned(),
            id: id.unwrap_or(NESTED) + bounded + distance,
            capacity,
            string_capacity,
            nested,
        })
    }
}

/// `FieldType`'s number of a type that is no message.
fn primitive(name: &str) -> Option<u8> {
    Some(match name {
        "int8" => 2,
        // What ROS calls `char` is a byte without a sign.
        "uint8" | "char" => UINT8,
        "int16" => 4,
        "uint16" => 5,
        "int32" => 6,
        "uint32" => 7,
        "int64" => 8,
        "uint64" => 9,
        "float32" => 10,
        "float64" => 11,
        "bool" => 15,
        "byte" => 16,
        "string" => STRING,
        "wstring" => STRING + 1,
        _ => return None,
    })
}

/// `package/msg/Name`; within a package its name may be left out, and `msg` too.
fn nested_name(name: &str, package: &str) -> Option<String> {
    let parts: Vec<&str> = name.split('/').collect();
    let (package, name) = match parts[..] {
        ["Header"] => ("std_msgs", "Header"),
        [name] => (package, name),
        [package, name] | [package, "msg", name] => (package, name),
        _ => return None,
    };
    (is_identifier(package) && is_identifier(name)).then(|| format!("{package}/msg/{name}"))
}

fn is_identifier(name: &str) -> bool {
    !name.is_empty() && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_')
}

/// The fields of every message in the text, by name.
fn definitions(schema: &Schema) -> Result<BTreeMap<String, Vec<Field>>, String> {
    let unknown = |line: &str| format!("`{line}` in it is not understood");
    let mut types = BTreeMap::new();
    let mut name = nested_name(schema.name, "").ok_or_else(|| unknown(schema.name))?;
    let mut fields = Vec::new();
    for line in schema.text.lines().chain([RULE]) {
        // A default value may hold a `#`, but it comes behind what is needed.
        let line = line.split('#').next().unwrap_or_default().trim();
        if line.starts_with(RULE) {
            let done = std::mem::take(&mut fields);
            types.insert(std::mem::take(&mut name), or_placeholder(done));
        } else if let Some(next) = line.strip_prefix("MSG:") {
            name = nested_name(next.trim(), "").ok_or_else(|| unknown(line))?;
        } else if !line.is_empty() {
            let mut words = line.split_whitespace();
            let (kind, field) = (words.next(), words.next());
            let (kind, field) = kind.zip(field).ok_or_else(|| unknown(line))?;
            let is_constant =
                field.contains('=') || words.next().is_some_and(|w| w.starts_with('='));
            if !is_constant {
                let package = name.split('/').next().unwrap_or_default();
                let field = Field::parse(kind, field, package).ok_or_else(|| unknown(line))?;
                fields.push(field);
            }
        }
    }
    Ok(types)
}

/// A message without fields has one all the same, as C knows no empty structures.
fn or_placeholder(fields: Vec<Field>) -> Vec<Field> {
    if !fields.is_empty() {
        return fields;
    }
    vec![Field {
        name: "structure_needs_at_least_one_member".to_owned(),
        id: UINT8,
        capacity: 0,
        string_capacity: 0,
        nested: String::new(),
    }]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros;

    #[track_caller]
    fn check(name: &'static str, text: &'static str, expected: &str) {
        let found = type_hash(&Schema { name, text });
        assert_eq!(found.as_deref(), Ok(expected), "{name}");
    }

    /// Hashes as `ros2 topic info --verbose` of Jazzy prints them, found in public logs and in other implementations.
    #[test]
    fn hashes_are_those_that_ros_publishes() {
        check(
            "std_msgs/msg/String",
            "string data",
            "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
        );
        check(
            "builtin_interfaces/msg/Time",
            "# comment\nint32 sec # seconds\n\nuint32 nanosec\n",
            "RIHS01_b106235e25a4c5ed35098aa0a61a3ee9c9b18d197f398b0e4206cea9acf9c197",
        );
        for (schema, expected) in [
            (
                ros::IMAGE,
                "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47",
            ),
            (
                ros::CAMERA_INFO,
                "RIHS01_b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275",
            ),
            (
                ros::POSE_STAMPED,
                "RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
            ),
        ] {
            check(schema.name, schema.text, expected);
        }
    }

    #[test]
    fn constants_do_not_count_and_types_of_the_same_package_need_no_package() {
        check(
            "sensor_msgs/msg/PointCloud2",
            "std_msgs/Header header\nuint32 height\nuint32 width\nPointField[] fields\nbool is_bigendian\n\
             uint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense\n\
             ========\nMSG: sensor_msgs/PointField\nuint8 INT8    = 1\nuint8 UINT8=2\nstring name\nuint32 offset\n\
             uint8  datatype\nuint32 count\n\
             ========\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n\
             ========\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n",
            "RIHS01_9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5",
        );
    }

    #[test]
    fn bounds_count_and_default_values_do_not() {
        check(
            "rcl_interfaces/msg/ParameterDescriptor",
            "string name\nuint8 type\nstring description\nstring additional_constraints\nbool read_only false\n\
             bool dynamic_typing false\nFloatingPointRange[<=1] floating_point_range\nIntegerRange[<=1] integer_range\n\
             ========\nMSG: rcl_interfaces/FloatingPointRange\nfloat64 from_value\nfloat64 to_value\nfloat64 step\n\
             ========\nMSG: rcl_interfaces/IntegerRange\nint64 from_value\nint64 to_value\nuint64 step\n",
            "RIHS01_52175dbfda6c51153101d33d2a9da05743f66f02d5ab2ca9ec4709b46b73d704",
        );
    }

    #[test]
    fn a_message_without_fields_has_the_placeholder_that_ros_gives_it() {
        check(
            "std_msgs/msg/Empty",
            "",
            "RIHS01_20b625256f32d5dbc0d04fee44f43c41e51c70d3502f84b4a08e7a9c26a96312",
        );
    }

    #[track_caller]
    fn check_refused(text: &'static str, word: &str) {
        let name = "a_msgs/msg/A";
        let error = type_hash(&Schema { name, text }).expect_err("no definition");
        assert!(error.contains(word), "`{word}` is not in: {error}");
    }

    #[test]
    fn a_definition_that_cannot_be_understood_is_refused_with_the_line() {
        check_refused("uint8", "`uint8`");
        check_refused("uint8[ x", "`uint8[ x`");
        check_refused("uint8[-1] x", "`uint8[-1] x`");
        check_refused("uint8<=3 x", "`uint8<=3 x`");
        check_refused("uint8 x\"y", "x\"y");
        check_refused("b_msgs/B b", "b_msgs/msg/B is not defined");
        check_refused("uint8 x\n========\nMSG: b/c/d/e\nuint8 x", "`MSG: b/c/d/e`");
    }
}
