//! Normals of vertices, four bytes each.

use crate::math::octahedral;
use glam::Vec3;

/// Normals by index. Those that are zero or not finite come back as NaN.
#[derive(Default)]
pub(crate) struct Normals(Vec<u32>);

/// Stands for a normal that cannot be used; no code of a direction.
const UNUSABLE: u32 = 0;

impl Normals {
    pub(crate) fn with_capacity(capacity: usize) -> Self {
        Self(Vec::with_capacity(capacity))
    }

    pub(crate) fn len(&self) -> usize {
        self.0.len()
    }

    pub(crate) fn push(&mut self, normal: [f32; 3]) {
        self.0.push(octahedral::encode_any(Vec3::from(normal)).unwrap_or(UNUSABLE));
    }

    #[inline]
    pub(crate) fn get(&self, index: usize) -> Vec3 {
        self.0.get(index).filter(|code| **code != UNUSABLE).map_or(Vec3::NAN, |code| octahedral::decode(*code))
    }
}

#[cfg(test)]
mod tests {
    use crate::import::collect::Collector;
    use crate::import::testing::read_bytes;
    use base64::Engine;
    use glam::Vec3;

    const NORMALS: [[f32; 3]; 3] = [[0.0, 0.0, 2.0], [1.0, 0.0, 1.0], [0.0, -3.0, 4.0]];

    fn assert_near(sink: &Collector, triangle: usize, expected: [Vec3; 3]) {
        let normals = sink.direct()[triangle].normals.expect("normals");
        for (normal, expected) in normals.iter().zip(expected) {
            assert!(normal.normalize().distance(expected.normalize()) < 1e-4, "{normals:?}");
        }
    }

    #[test]
    fn ply_in_rows_of_floats_and_others() {
        let header = |format: &str, more: &str| {
            let axes = "property float x\nproperty float y\nproperty float z\n";
            let normal = "property float nx\nproperty float ny\nproperty float nz\n";
            let faces = "element face 1\nproperty list uchar int vertex_indices\n";
            format!("ply\nformat {format} 1.0\nelement vertex 3\n{axes}{more}{normal}{faces}end_header\n")
        };
        let corners = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        for (more, colour) in [("", false), ("property uchar red\nproperty uchar green\nproperty uchar blue\n", true)] {
            let mut bytes = header("binary_little_endian", more).into_bytes();
            for (corner, normal) in corners.iter().zip(NORMALS) {
                corner.iter().for_each(|x| bytes.extend(x.to_le_bytes()));
                bytes.extend(if colour { &[1u8, 2, 3][..] } else { &[] });
                normal.iter().for_each(|x| bytes.extend(x.to_le_bytes()));
            }
            bytes.push(3);
            (0..3).for_each(|i: i32| bytes.extend(i.to_le_bytes()));
            let sink = read_bytes("a.ply", bytes).expect("a mesh");
            assert_near(&sink, 0, NORMALS.map(Vec3::from));
            assert_eq!(sink.direct()[0].colours.is_some(), colour);
        }
        let rows = "0 0 0 0 0 2\n1 0 0 nan 0 1\n0 1 0 0 0 0\n3 0 1 2\n";
        let sink = read_bytes("a.ply", header("ascii", "") + rows).expect("a mesh");
        let normals = sink.direct()[0].normals.expect("normals");
        assert!(normals[0].is_finite() && normals[1].is_nan() && normals[2].is_nan(), "{normals:?}");
    }

    /// Faces with normals at all corners have them; those before and behind keep their order.
    #[test]
    fn obj_by_face() {
        let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 2\nvn 1 0 1\nvn 0 -3 4\nvn 1 2 # two\n\
                    f 1 2 3\nf 1//1 2//2 3//3\nf 3//-2 2//2 1//1\nf 1//1 2 3\nf 1//1 2//4 3//9\n";
        let sink = read_bytes("a.obj", text).expect("a mesh");
        assert_eq!(
            sink.direct().iter().map(|t| t.normals.is_some()).collect::<Vec<_>>(),
            [false, true, true, false, false]
        );
        let [a, b, c] = NORMALS.map(Vec3::from);
        assert_near(&sink, 1, [a, b, c]);
        assert_near(&sink, 2, [c, b, a]);
        assert!(sink.direct().iter().enumerate().all(|(i, t)| t.prim == i as u64));
        assert!(sink.notes.is_empty(), "{:?}", sink.notes);
    }

    /// A transform of the node turns them as it turns surfaces.
    #[test]
    fn gltf_with_a_transform() {
        let corners = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let bytes: Vec<u8> = corners.iter().chain(&NORMALS).flatten().flat_map(|x| x.to_le_bytes()).collect();
        let data = base64::engine::general_purpose::STANDARD.encode(&bytes);
        let document = |count: usize| {
            format!(
                r#"{{"asset":{{"version":"2.0"}},"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0,"scale":[1,2,4]}}],
                "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"NORMAL":1}}}}]}}],
                "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}},
                {{"bufferView":0,"byteOffset":36,"componentType":5126,"count":{count},"type":"VEC3"}}],
                "bufferViews":[{{"buffer":0,"byteLength":72}}],
                "buffers":[{{"byteLength":72,"uri":"data:application/octet-stream;base64,{data}"}}]}}"#
            )
        };
        let sink = read_bytes("a.gltf", document(3)).expect("a mesh");
        // By the inverse of the scale.
        assert_near(&sink, 0, NORMALS.map(|n| Vec3::from(n) / Vec3::new(1.0, 2.0, 4.0)));
        let sink = read_bytes("a.gltf", document(2)).expect("a mesh");
        assert!(sink.direct()[0].normals.is_none() && sink.notes[0].contains("normals"), "{:?}", sink.notes);
    }
}
