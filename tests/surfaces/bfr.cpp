// Values of limit surfaces by OpenSubdiv 3.5's Bfr, for `bfr.rs`.
//
//     g++ -O2 -o bfr bfr.cpp -losdCPU && ./bfr ../common/cages.obj bfr.bin 120
//
// Per cage: the number of records (u32); per record: face and corner (u32), u and v (f64), position (3 f64), derivatives
// by u and v of the face's quad (6 f32). Half of the points lie within 2^-6 of a corner of their quad.

#include <opensubdiv/bfr/refinerSurfaceFactory.h>
#include <opensubdiv/bfr/surface.h>
#include <opensubdiv/far/topologyDescriptor.h>
#include <opensubdiv/far/topologyRefinerFactory.h>

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

using namespace OpenSubdiv;

// The deepest level that OpenSubdiv 3.5 takes: it approximates within 2^-LEVEL of irregular vertices.
static int const LEVEL = 10;

struct Cage {
    std::string name;
    std::vector<double> points;
    std::vector<int> sizes, indices, creases, corners, holes;
    std::vector<float> crease_sharpness, corner_sharpness;
    Sdc::Options options;
    Cage() { options.SetVtxBoundaryInterpolation(Sdc::Options::VTX_BOUNDARY_EDGE_ONLY); }
};

static void read_tag(Cage& cage, std::istringstream& words) {
    std::string tag, counts, text;
    words >> tag >> counts;
    int a = 0, b = 0;
    float s = 0;
    if (tag == "crease") {
        words >> a >> b >> s;
        cage.creases.insert(cage.creases.end(), {a, b});
        cage.crease_sharpness.push_back(s);
    } else if (tag == "corner") {
        words >> a >> s;
        cage.corners.push_back(a);
        cage.corner_sharpness.push_back(s);
    } else if (tag == "hole") {
        words >> a;
        cage.holes.push_back(a);
    } else if (tag == "interpolateboundary") {
        words >> a;
        cage.options.SetVtxBoundaryInterpolation(a == 0   ? Sdc::Options::VTX_BOUNDARY_NONE
                                                 : a == 1 ? Sdc::Options::VTX_BOUNDARY_EDGE_AND_CORNER
                                                          : Sdc::Options::VTX_BOUNDARY_EDGE_ONLY);
    } else if (tag == "creasemethod") {
        cage.options.SetCreasingMethod(Sdc::Options::CREASE_CHAIKIN);
    } else if (tag == "smoothtriangles") {
        cage.options.SetTriangleSubdivision(Sdc::Options::TRI_SUB_SMOOTH);
    }
}

static std::vector<Cage> read_cages(char const* file) {
    std::vector<Cage> cages;
    std::ifstream in(file);
    for (std::string line; std::getline(in, line);) {
        std::istringstream words(line);
        std::string key;
        words >> key;
        if (key == "o" || (cages.empty() && key == "v")) cages.emplace_back();
        if (cages.empty()) continue;
        Cage& cage = cages.back();
        if (key == "o") {
            words >> cage.name;
        } else if (key == "v") {
            double x, y, z;
            words >> x >> y >> z;
            cage.points.insert(cage.points.end(), {x, y, z});
        } else if (key == "f") {
            int size = 0;
            for (std::string corner; words >> corner; ++size) cage.indices.push_back(atoi(corner.c_str()) - 1);
            cage.sizes.push_back(size);
        } else if (key == "t") {
            read_tag(cage, words);
        }
    }
    return cages;
}

static std::unique_ptr<Far::TopologyRefiner> refiner_of(Cage const& cage) {
    Far::TopologyDescriptor desc;
    desc.numVertices = int(cage.points.size() / 3);
    desc.numFaces = int(cage.sizes.size());
    desc.numVertsPerFace = cage.sizes.data();
    desc.vertIndicesPerFace = cage.indices.data();
    desc.numCreases = int(cage.crease_sharpness.size());
    desc.creaseVertexIndexPairs = cage.creases.data();
    desc.creaseWeights = cage.crease_sharpness.data();
    desc.numCorners = int(cage.corners.size());
    desc.cornerVertexIndices = cage.corners.data();
    desc.cornerWeights = cage.corner_sharpness.data();
    desc.numHoles = int(cage.holes.size());
    desc.holeIndices = cage.holes.data();
    using Factory = Far::TopologyRefinerFactory<Far::TopologyDescriptor>;
    return std::unique_ptr<Far::TopologyRefiner>(
        Factory::Create(desc, Factory::Options(Sdc::SCHEME_CATMARK, cage.options)));
}

// SplitMix64: Steele, Lea, Flood, OOPSLA 2014.
static uint64_t state = 51;
static double unit() {
    uint64_t z = (state += 0x9e3779b97f4a7c15ull);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
    return double((z ^ (z >> 31)) >> 11) / 9007199254740992.0;
}

template <typename T>
static void put(FILE* out, T const* values, size_t count) {
    fwrite(values, sizeof(T), count, out);
}

static void write_point(FILE* out, Bfr::Surface<double>& surface, std::vector<double> const& points, int face) {
    Bfr::Parameterization param = surface.GetParameterization();
    int size = param.GetFaceSize();
    double quad[2] = {unit(), unit()}, uv[2];
    if (unit() < 0.5) {
        double near = std::exp2(-6 - 8 * unit());
        int corner = int(4 * unit());
        quad[0] *= near;
        quad[1] *= near;
        if (corner & 1) quad[0] = 1 - quad[0];
        if (corner & 2) quad[1] = 1 - quad[1];
    }
    uint32_t ids[2] = {uint32_t(face), size == 4 ? 0 : uint32_t(size * unit())};
    double scale = size == 4 ? 1 : 0.5;
    if (size == 4) {
        uv[0] = quad[0];
        uv[1] = quad[1];
    } else {
        param.ConvertNormalizedSubFaceToCoord(int(ids[1]), quad, uv);
    }
    double values[9];
    surface.Evaluate(uv, points.data(), 3, values, values + 3, values + 6);
    float derivatives[6];
    for (int i = 0; i < 6; ++i) derivatives[i] = float(values[3 + i] * scale);
    put(out, ids, 2);
    put(out, quad, 2);
    put(out, values, 3);
    put(out, derivatives, 6);
}

int main(int count, char** words) {
    if (count != 4) return fprintf(stderr, "bfr CAGES.obj OUT.bin POINTS_A_CAGE\n"), 1;
    FILE* out = fopen(words[2], "wb");
    uint32_t wanted = uint32_t(atoi(words[3]));
    for (Cage const& cage : read_cages(words[1])) {
        auto refiner = refiner_of(cage);
        Bfr::RefinerSurfaceFactory<>::Options options;
        options.SetApproxLevelSharp(LEVEL).SetApproxLevelSmooth(LEVEL);
        Bfr::RefinerSurfaceFactory<> factory(*refiner, options);
        std::vector<int> faces;
        for (int face = 0; face < int(cage.sizes.size()); ++face) {
            if (factory.FaceHasLimitSurface(face)) faces.push_back(face);
        }
        uint32_t records = faces.empty() ? 0 : wanted;
        put(out, &records, 1);
        // Points are spread over the faces, and follow each other by faces.
        for (uint32_t i = 0, last = ~0u; i < records; ++i) {
            static Bfr::Surface<double> surface;
            static std::vector<double> points;
            uint32_t k = uint32_t(uint64_t(i) * faces.size() / records);
            if (k != last) {
                if (!factory.InitVertexSurface(faces[k], &surface)) return fprintf(stderr, "no surface\n"), 1;
                points.resize(size_t(surface.GetNumPatchPoints()) * 3);
                surface.PreparePatchPoints(cage.points.data(), 3, points.data(), 3);
                last = k;
            }
            write_point(out, surface, points, faces[k]);
        }
        printf("%s: %u points, %zu of %zu faces\n", cage.name.c_str(), records, faces.size(), cage.sizes.size());
    }
    return fclose(out);
}
