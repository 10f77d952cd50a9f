//! The shared test models: what their README says of them.
// Each test binary uses its own share.
#![allow(dead_code)]

/// How a file is divided.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// One mesh.
    Whole,
    /// OBJ: `o` and `g` lines, by the README, also of groups without faces; and the parts that a
    /// separate script found: objects, groups within them, materials where one has several.
    Groups(usize, usize),
    /// Primitives, and how often nodes place them.
    Meshes(usize, usize),
}
use Shape::*;

/// A mesh, as measured by other readers.
#[derive(Debug, Clone, Copy)]
pub struct Row {
    pub file: &'static str,
    pub triangles: usize,
    pub shape: Shape,
    /// Least and greatest corner to four digits; `None` without triangles.
    pub bounds: Option<[[f64; 3]; 2]>,
}

/// Every mesh of the README that a reader of ours should read.
#[rustfmt::skip]
pub const MODELS: &[Row] = &[
    Row { file: "scans/armadillo.ply", triangles: 345944, shape: Whole, bounds: Some([[-63.5, -54.24, -57.71], [63.5, 97.08, 57.71]]) },
    Row { file: "scans/bun_zipper.ply", triangles: 69451, shape: Whole, bounds: Some([[-0.09469, 0.03299, -0.06187], [0.06101, 0.1873, 0.0588]]) },
    Row { file: "scans/asian_dragon_100k.ply", triangles: 100000, shape: Whole, bounds: Some([[-98.67, -41.3, -57.25], [103.1, 49.26, 76.86]]) },
    Row { file: "scans/happy_buddha_100k.obj", triangles: 100000, shape: Whole, bounds: Some([[-0.461, -1.002, -0.3239], [0.3522, 0.9775, 0.4902]]) },
    Row { file: "scans/turbine_blade_200k.ply", triangles: 199034, shape: Whole, bounds: Some([[-10.93, -5.967, 106.1], [11.59, 9.066, 148.9]]) },
    Row { file: "scans/bun000_range_grid.ply", triangles: 0, shape: Whole, bounds: None },
    Row { file: "cad/sportsCar.obj", triangles: 300603, shape: Groups(1075, 1075), bounds: Some([[-1.14, -0.0036, -2.331], [1.14, 1.087, 2.236]]) },
    Row { file: "cad/2CylinderEngine.glb", triangles: 121496, shape: Meshes(34, 115), bounds: Some([[-371.7, -181.0, -140.0], [371.7, 92.04, 128.0]]) },
    Row { file: "cad/franka_fer_arm.glb", triangles: 134924, shape: Meshes(57, 59), bounds: Some([[-0.2314, -0.1294, 0.0], [0.3509, 0.1299, 0.7789]]) },
    Row { file: "cad/nist_ctc_02.glb", triangles: 706648, shape: Meshes(1, 1), bounds: Some([[-340.0, -40.0, -360.0], [340.0, 820.0, 40.0]]) },
    Row { file: "cad/as1_assembly.glb", triangles: 21324, shape: Meshes(18, 18), bounds: Some([[-10.0, 0.0, -4.0], [190.0, 150.0, 80.0]]) },
    Row { file: "cad/sheet_box_assembly.glb", triangles: 7496, shape: Meshes(10, 10), bounds: Some([[-18.45, 46.72, 112.6], [165.7, 161.0, 207.8]]) },
    Row { file: "cad/tray_bottom.stl", triangles: 4520, shape: Whole, bounds: Some([[0.0, 0.0, -355.6], [355.6, 3.175, 0.0]]) },
    Row { file: "cad/counter.unitsmm.stl", triangles: 83750, shape: Whole, bounds: Some([[-111.5, 5.779, 255.9], [193.3, 310.2, 281.7]]) },
    Row { file: "architecture/conference.obj", triangles: 331179, shape: Groups(41, 41), bounds: Some([[-1020.0, -2.792, -1056.0], [1686.0, 650.3, 668.5]]) },
    Row { file: "architecture/lost_empire.obj", triangles: 224998, shape: Groups(46, 46), bounds: Some([[-37.0, 0.0, -82.0], [38.0, 49.0, 83.0]]) },
    Row { file: "architecture/sponza_dabrovic.obj", triangles: 66450, shape: Groups(33, 39), bounds: Some([[-17.4, -0.9067, -7.799], [17.42, 15.65, 7.801]]) },
    Row { file: "architecture/cornell_box_original.obj", triangles: 36, shape: Groups(8, 9), bounds: Some([[-1.02, 0.0, -1.04], [1.0, 1.99, 0.99]]) },
    Row { file: "architecture/lyon_tile_0.glb", triangles: 10108, shape: Meshes(12, 12), bounds: Some([[-518.9, -46.52, -154.5], [459.8, 67.88, 181.0]]) },
    Row { file: "architecture/lyon_tile_1.glb", triangles: 11641, shape: Meshes(17, 17), bounds: Some([[-212.4, -33.01, -244.4], [166.1, 59.29, 326.6]]) },
    Row { file: "architecture/boiler_room_bim.glb", triangles: 32457, shape: Meshes(1, 1), bounds: Some([[-36.31, -10.81, -35.3], [30.46, 17.18, 24.11]]) },
    Row { file: "vegetation/fern_02.glb", triangles: 6232, shape: Meshes(4, 4), bounds: Some([[-0.5281, -0.03051, -0.4219], [1.444, 0.3972, 1.302]]) },
    Row { file: "vegetation/scrub_pine.obj", triangles: 527, shape: Groups(2, 6), bounds: Some([[-374.5, 3.034, -431.9], [341.1, 933.9, 269.7]]) },
    Row { file: "vegetation/palm_tree.glb", triangles: 10124, shape: Meshes(10, 10), bounds: Some([[-196.0, -1.028, -196.0], [196.0, 3.827, 196.0]]) },
    Row { file: "hostile/thingi_1514499_slivers.stl", triangles: 26700, shape: Whole, bounds: Some([[0.0, -0.4, 16.7], [112.6, 95.46, 20.51]]) },
    Row { file: "hostile/generic_twin_left.obj", triangles: 19704, shape: Whole, bounds: Some([[-23920.0, 1855.0, 4389.0], [-15670.0, 16580.0, 6234.0]]) },
    Row { file: "hostile/offset1.obj", triangles: 4418, shape: Whole, bounds: Some([[4646.0, -20170.0, 1482.0], [5362.0, -18790.0, 5449.0]]) },
    Row { file: "hostile/self_intersectA.obj", triangles: 17160, shape: Whole, bounds: Some([[-0.9806, -0.1193, -0.125], [0.6587, 0.8559, 1.866]]) },
    Row { file: "hostile/chair_dup_faces.obj", triangles: 12756, shape: Groups(20, 6), bounds: Some([[-0.2655, -0.3319, -0.2634], [0.2655, 0.3319, 0.2634]]) },
    Row { file: "hostile/lyon_terrain_torn.obj", triangles: 19766, shape: Whole, bounds: Some([[-250.0, 139.5, 24.4], [-187.3, 193.0, 48.64]]) },
    Row { file: "hostile/wallhole_line_continuation.obj", triangles: 66, shape: Whole, bounds: Some([[0.0, 0.0, -10.0], [10.0, 15.0, 0.0]]) },
    Row { file: "subdivision/catmark_car.obj", triangles: 3150, shape: Whole, bounds: Some([[-0.1941, -3.764, -0.04643], [1.433, -0.00025, 0.7237]]) },
    Row { file: "subdivision/catmark_rook.obj", triangles: 1510, shape: Whole, bounds: Some([[2.75, -1.946, 0.02], [3.16, -1.536, 0.675]]) },
    Row { file: "subdivision/catmark_helmet.obj", triangles: 116, shape: Whole, bounds: Some([[-0.766, -1.048, -0.9164], [0.766, -0.3214, 0.9164]]) },
    Row { file: "subdivision/catmark_cube_creases1.obj", triangles: 12, shape: Whole, bounds: Some([[-1.414, -1.414, -1.0], [1.414, 1.414, 1.0]]) },
    Row { file: "subdivision/catmark_tent_creases1.obj", triangles: 18, shape: Whole, bounds: Some([[-1.697, -1.697, 0.0], [1.697, 1.697, 0.8]]) },
    Row { file: "subdivision/catmark_dart_edgecorner.obj", triangles: 32, shape: Whole, bounds: Some([[-2.0, -2.0, 0.0], [2.0, 2.0, 1.0]]) },
    Row { file: "subdivision/catmark_edgeonly.obj", triangles: 40, shape: Whole, bounds: Some([[-1.25, -0.25, -1.25], [1.25, 0.0, 1.25]]) },
    Row { file: "subdivision/catmark_nonquads.obj", triangles: 32, shape: Whole, bounds: Some([[-1.25, -0.5, -1.35], [1.25, 0.15, 1.25]]) },
    Row { file: "subdivision/catmark_xord_interior.obj", triangles: 142, shape: Whole, bounds: Some([[-1.85, -0.48, -1.85], [1.83, 0.0, 1.85]]) },
    Row { file: "subdivision/catmark_pole64.obj", triangles: 192, shape: Whole, bounds: Some([[-0.7849, -1.0, -0.7849], [0.7849, -0.7836, 0.7849]]) },
    Row { file: "subdivision/catmark_nonman_edges.obj", triangles: 169, shape: Whole, bounds: Some([[-1.75, -0.6, -1.75], [1.75, 0.5, 1.75]]) },
    Row { file: "subdivision/baseline/catmark_cube_creases1_level4.obj", triangles: 12288, shape: Whole, bounds: Some([[-1.414, -1.414, -1.0], [1.414, 0.9669, 1.0]]) },
    Row { file: "subdivision/baseline/catmark_tent_creases1_level3.obj", triangles: 4608, shape: Whole, bounds: Some([[-1.697, -1.697, 0.0], [1.697, 1.697, 0.7453]]) },
    Row { file: "subdivision/baseline/catmark_edgeonly_level3.obj", triangles: 10240, shape: Whole, bounds: Some([[-1.25, -0.2397, -1.25], [1.25, 0.0, 1.25]]) },
    Row { file: "subdivision/spot_control_mesh.obj", triangles: 372, shape: Whole, bounds: Some([[-0.586, -0.7591, -0.6962], [0.586, 0.984, 1.078]]) },
];
