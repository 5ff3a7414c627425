//! `sensor_msgs/msg/PointCloud2`: points with named fields.

use maps::time::Stamp;

use super::{CdrError, Reader, Schema, Writer, read_header, write_header};

/// Points.
pub const POINT_CLOUD2: Schema = Schema {
    name: "sensor_msgs/msg/PointCloud2",
    text: concat!(
        "std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\nbool is_bigendian\n",
        "uint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense\n",
        header!(),
        dependencies!(
            "sensor_msgs/PointField": "string name\nuint32 offset\nuint8 datatype\nuint32 count\n"
        )
    ),
};

/// What a field of a point is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldType {
    /// An unsigned byte.
    U8,
    /// Two bytes, unsigned.
    U16,
    /// Single precision.
    F32,
}

impl FieldType {
    /// As `sensor_msgs/msg/PointField` numbers them.
    fn number(self) -> u8 {
        match self {
            Self::U8 => 2,
            Self::U16 => 4,
            Self::F32 => 7,
        }
    }

    fn size(self) -> u32 {
        match self {
            Self::U8 => 1,
            Self::U16 => 2,
            Self::F32 => 4,
        }
    }
}

/// A cloud to be sent: its points are one packed record after another, little-endian.
#[derive(Clone, Debug, PartialEq)]
pub struct Cloud<'a> {
    /// When it was taken; of a sweep, its start.
    pub at: Stamp,
    /// The sensor, as `tf2` knows it.
    pub frame_id: &'a str,
    /// The fields of a record, in their order, without gaps.
    pub fields: &'a [(&'a str, FieldType)],
    /// The records.
    pub data: &'a [u8],
}

impl Cloud<'_> {
    /// The message in CDR. Bytes after the last whole record are left out.
    pub fn encode(&self) -> Vec<u8> {
        let step: u32 = self.fields.iter().map(|(_, kind)| kind.size()).sum();
        let count = (self.data.len() as u32).checked_div(step).unwrap_or(0);
        let mut writer = Writer::new();
        write_header(&mut writer, self.at, self.frame_id);
        writer.u32(1);
        writer.u32(count);
        writer.length(self.fields.len());
        let mut offset = 0;
        for (name, kind) in self.fields {
            writer.string(name);
            writer.u32(offset);
            writer.u8(kind.number());
            writer.u32(1);
            offset += kind.size();
        }
        writer.u8(0);
        writer.u32(step);
        writer.u32(step * count);
        writer.bytes(&self.data[..(step * count) as usize]);
        writer.u8(1);
        writer.finish()
    }
}

/// The places of a cloud's points, in metres, in the sensor's frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Places<'a> {
    /// When it was taken.
    pub at: Stamp,
    /// The sensor, as `tf2` knows it.
    pub frame_id: &'a str,
    /// x, y and z of each point whose three are finite.
    pub points: Vec<[f32; 3]>,
}

/// Reads `x`, `y` and `z` of a cloud whose fields are single precision and little-endian; `None` if it is none such, or
/// says that it has more points than bytes.
pub fn decode_places(message: &[u8]) -> Result<Option<Places<'_>>, CdrError> {
    let mut reader = Reader::new(message)?;
    let (at, frame_id) = read_header(&mut reader)?;
    let (height, width) = (reader.u32()?, reader.u32()?);
    let mut offsets = [None; 3];
    for _ in 0..reader.u32()? {
        let name = reader.string()?;
        let (offset, kind, count) = (reader.u32()?, reader.u8()?, reader.u32()?);
        let axis = ["x", "y", "z"].iter().position(|axis| *axis == name);
        if let Some(axis) = axis.filter(|_| kind == FieldType::F32.number() && count == 1) {
            offsets[axis] = Some(offset as usize);
        }
    }
    let is_bigendian = reader.u8()? != 0;
    let (step, row_step) = (reader.u32()? as usize, reader.u32()? as usize);
    let data = reader.bytes()?;
    let ([Some(x), Some(y), Some(z)], false) = (offsets, is_bigendian) else {
        return Ok(None);
    };
    let rows = height as usize;
    if step == 0
        || data.len() < rows.saturating_mul(row_step)
        || row_step < step.saturating_mul(width as usize)
    {
        return Ok(None);
    }
    let float = |record: &[u8], offset: usize| {
        let bytes = record.get(offset..offset + 4)?;
        Some(f32::from_le_bytes(bytes.try_into().ok()?))
    };
    let mut points = Vec::new();
    for row in data.chunks_exact(row_step.max(1)).take(rows) {
        for record in row.chunks_exact(step).take(width as usize) {
            let place = [float(record, x), float(record, y), float(record, z)];
            if let [Some(x), Some(y), Some(z)] = place
                && [x, y, z].iter().all(|c| c.is_finite())
            {
                points.push([x, y, z]);
            }
        }
    }
    Ok(Some(Places {
        at,
        frame_id,
        points,
    }))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const FIELDS: [(&str, FieldType); 5] = [
        ("x", FieldType::F32),
        ("y", FieldType::F32),
        ("z", FieldType::F32),
        ("intensity", FieldType::U8),
        ("ring", FieldType::U16),
    ];

    fn records(points: &[[f32; 3]]) -> Vec<u8> {
        let record = |p: &[f32; 3]| {
            let mut bytes: Vec<u8> = p.iter().flat_map(|c| c.to_le_bytes()).collect();
            bytes.extend([9, 1, 0]);
            bytes
        };
        points.iter().flat_map(record).collect()
    }

    #[test]
    fn points_come_back_without_those_that_are_not_finite() {
        let data = records(&[[1.0, 2.0, 3.0], [f32::NAN, 0.0, 0.0], [-1.0, 0.5, 0.0]]);
        let message = Cloud {
            at: Stamp::from_nanos(7),
            frame_id: "lidar",
            fields: &FIELDS,
            data: &data,
        }
        .encode();
        let places = decode_places(&message)
            .expect("own message")
            .expect("x, y and z");
        assert_eq!(places.points, [[1.0, 2.0, 3.0], [-1.0, 0.5, 0.0]]);
        assert_eq!(
            (places.at, places.frame_id),
            (Stamp::from_nanos(7), "lidar")
        );
    }

    #[test]
    fn a_cloud_without_height_has_no_places() {
        let message = Cloud {
            at: Stamp::ZERO,
            frame_id: "radar",
            fields: &FIELDS[..2],
            data: &[0; 16],
        }
        .encode();
        assert_eq!(decode_places(&message), Ok(None));
    }

    proptest! {
        #[test]
        fn any_bytes_are_decoded_or_refused(mut message: Vec<u8>) {
            if let Some(header) = message.get_mut(..4) {
                header.copy_from_slice(&[0, 1, 0, 0]);
            }
            let _outcome = decode_places(&message).is_ok();
        }

        #[test]
        fn a_cloud_with_any_byte_changed_is_decoded_or_refused(at in 0_usize..300, byte: u8) {
            let data = records(&[[1.0, 2.0, 3.0]; 3]);
            let cloud = Cloud { at: Stamp::ZERO, frame_id: "lidar", fields: &FIELDS, data: &data };
            let mut message = cloud.encode();
            let at = 4 + at % (message.len() - 4);
            message[at] = byte;
            let _outcome = decode_places(&message).is_ok();
        }
    }
}
