// The mesh that both sides trace: from a PLY file, or a generated torus.
#ifndef COMPARE_MESH_HPP
#define COMPARE_MESH_HPP

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

struct Mesh {
    std::vector<float> positions; // three for each vertex, and one more at the end: Embree reads 16 bytes of a vertex
    std::vector<std::uint32_t> indices;
    std::size_t triangles() const { return indices.size() / 3; }
};

// Reads triangles from PLY: ASCII or binary of either byte order, all scalar types. Splits polygons into fans from
// their first corner. Checks only as much as an example needs.
class PlyReader {
  public:
    explicit PlyReader(const std::string &path) : file_(path.c_str(), std::ios::binary) {
        if (!file_) throw std::runtime_error(path + ": cannot be opened");
        std::string line;
        std::getline(file_, line);
        if (line.substr(0, 3) != "ply") throw std::runtime_error(path + ": not a PLY file");
        while (std::getline(file_, line) && line.substr(0, 10) != "end_header") header_line(line);
    }

    Mesh read() {
        Mesh mesh;
        for (const Element &element : elements_) {
            for (std::uint64_t i = 0; i < element.count && file_; i++) {
                float position[3] = {0, 0, 0};
                for (const Property &p : element.properties) {
                    const std::uint64_t n = p.list ? std::uint64_t(scalar(p.count_type)) : 1;
                    list_.clear();
                    for (std::uint64_t k = 0; k < n && file_; k++) list_.push_back(scalar(p.type));
                    if (p.axis >= 0 && element.name == "vertex") position[p.axis] = float(list_[0]);
                    if (p.list && p.name.substr(0, 5) == "verte") fan(mesh);
                }
                if (element.name == "vertex") mesh.positions.insert(mesh.positions.end(), position, position + 3);
            }
        }
        if (!file_) throw std::runtime_error("the PLY file ends early");
        for (std::uint32_t index : mesh.indices) {
            if (index >= mesh.positions.size() / 3) throw std::runtime_error("an index is out of range");
        }
        mesh.positions.push_back(0);
        return mesh;
    }

  private:
    struct Property {
        std::string name, type, count_type;
        bool list;
        int axis;
    };
    struct Element {
        std::string name;
        std::uint64_t count;
        std::vector<Property> properties;
    };

    void header_line(const std::string &line) {
        std::istringstream words(line);
        std::string word;
        words >> word;
        if (word == "format") {
            words >> word;
            ascii_ = word == "ascii";
            swap_ = word == "binary_big_endian";
        } else if (word == "element") {
            Element e;
            words >> e.name >> e.count;
            elements_.push_back(e);
        } else if (word == "property" && !elements_.empty()) {
            Property p;
            words >> p.type;
            p.list = p.type == "list";
            if (p.list) words >> p.count_type >> p.type;
            words >> p.name;
            p.axis = p.name == "x" ? 0 : p.name == "y" ? 1 : p.name == "z" ? 2 : -1;
            elements_.back().properties.push_back(p);
        }
    }

    template <class T> double raw() {
        unsigned char bytes[sizeof(T)], turned[sizeof(T)];
        file_.read(reinterpret_cast<char *>(bytes), sizeof(T));
        for (std::size_t i = 0; i < sizeof(T); i++) turned[i] = bytes[swap_ ? sizeof(T) - 1 - i : i];
        T value;
        std::memcpy(&value, turned, sizeof(T));
        return double(value);
    }

    double scalar(const std::string &type) {
        if (ascii_) {
            double value = 0;
            file_ >> value;
            return value;
        }
        if (type == "float" || type == "float32") return raw<float>();
        if (type == "double" || type == "float64") return raw<double>();
        if (type == "uchar" || type == "uint8") return raw<std::uint8_t>();
        if (type == "char" || type == "int8") return raw<std::int8_t>();
        if (type == "ushort" || type == "uint16") return raw<std::uint16_t>();
        if (type == "short" || type == "int16") return raw<std::int16_t>();
        if (type == "uint" || type == "uint32") return raw<std::uint32_t>();
        if (type == "int" || type == "int32") return raw<std::int32_t>();
        throw std::runtime_error("unknown PLY type " + type);
    }

    void fan(Mesh &mesh) {
        for (std::size_t k = 2; k < list_.size(); k++) {
            for (double corner : {list_[0], list_[k - 1], list_[k]}) mesh.indices.push_back(std::uint32_t(corner));
        }
    }

    std::ifstream file_;
    bool ascii_ = false, swap_ = false;
    std::vector<Element> elements_;
    std::vector<double> list_;
};

// Returns a torus of about `triangles` triangles.
inline Mesh torus(std::size_t triangles) {
    const double tau = 6.283185307179586;
    const auto v = std::uint32_t(std::sqrt(double(triangles) / 6)) + 3, u = 3 * v;
    Mesh mesh;
    for (std::uint32_t j = 0; j < v; j++) {
        for (std::uint32_t i = 0; i < u; i++) {
            const double s = tau * i / u, t = tau * j / v, r = 3 + std::cos(t);
            for (double x : {r * std::cos(s), r * std::sin(s), std::sin(t)}) mesh.positions.push_back(float(x));
            const std::uint32_t a = j * u + i, b = j * u + (i + 1) % u;
            const std::uint32_t c = (j + 1) % v * u + i, d = (j + 1) % v * u + (i + 1) % u;
            for (std::uint32_t index : {a, b, d, a, d, c}) mesh.indices.push_back(index);
        }
    }
    mesh.positions.push_back(0);
    return mesh;
}

#endif
