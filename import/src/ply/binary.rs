//! Elements of binary files in the layouts that programs write, read in place: a large mesh has millions, and a value for each
//! property of each takes ten times as long. Any other layout is left to the parser.

use ply_rs_bw::ply::{ElementDef, Encoding, PropertyType, ScalarType};

use super::{Vertex, field};

/// Four bytes of either order.
fn word(encoding: Encoding) -> Option<fn([u8; 4]) -> u32> {
    match encoding {
        Encoding::BinaryLittleEndian => Some(u32::from_le_bytes),
        Encoding::BinaryBigEndian => Some(u32::from_be_bytes),
        Encoding::Ascii => None,
    }
}

/// Take `count` records of `size` bytes; nothing where there are not so many.
fn records<'a>(rest: &mut &'a [u8], count: usize, size: usize) -> Option<std::slice::ChunksExact<'a, u8>> {
    let (taken, left) = rest.split_at_checked(count.checked_mul(size)?)?;
    *rest = left;
    Some(taken.chunks_exact(size))
}

/// Vertices of which every property is a `float`. `None`, and nothing taken, where it is otherwise.
pub(super) fn vertices(rest: &mut &[u8], element: &ElementDef, encoding: Encoding) -> Option<Vec<Vertex>> {
    let word = word(encoding)?;
    if element.properties.values().any(|p| !matches!(p.data_type, PropertyType::Scalar(ScalarType::Float))) {
        return None;
    }
    let names: Vec<&str> = element.properties.keys().map(String::as_str).collect();
    let records = records(rest, element.count, 4 * names.len())?;
    let vertex = |record: &[u8]| {
        let mut vertex = Vertex::default();
        for (name, bytes) in names.iter().zip(record.as_chunks().0) {
            if let Some(field) = field(&mut vertex, name) {
                *field = f32::from_bits(word(*bytes));
            }
        }
        vertex
    };
    Some(records.map(vertex).collect())
}

/// Faces that are nothing but triangles of 32-bit indices after a count of one byte. `None`, and nothing taken, where
/// one of them is otherwise.
pub(super) fn triangles(rest: &mut &[u8], element: &ElementDef, encoding: Encoding) -> Option<Vec<[u32; 3]>> {
    let word = word(encoding)?;
    let mut properties = element.properties.iter();
    let (Some((name, property)), None) = (properties.next(), properties.next()) else { return None };
    let signed = match property.data_type {
        PropertyType::List(ScalarType::UChar, ScalarType::Int) => true,
        PropertyType::List(ScalarType::UChar, ScalarType::UInt) => false,
        _ => return None,
    };
    if !super::INDICES.contains(&name.as_str()) {
        return None;
    }
    let mut ahead = *rest;
    let triangle = |record: &[u8]| {
        let [a, b, c] = record.get(1..)?.as_chunks().0 else { return None };
        let corners = [a, b, c].map(|bytes| word(*bytes));
        let above_zero = !signed || corners.iter().all(|&corner| i32::try_from(corner).is_ok());
        (record[0] == 3 && above_zero).then_some(corners)
    };
    let triangles = records(&mut ahead, element.count, 13)?.map(triangle).collect::<Option<Vec<_>>>()?;
    *rest = ahead;
    Some(triangles)
}
