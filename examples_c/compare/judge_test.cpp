// The judge of 03_compare_embree, against answers whose verdict is known.
#include "agreement.hpp"

#include <cstdlib>

namespace {

void expect(bool condition, const char *what) {
    if (condition) return;
    std::fprintf(stderr, "judge: %s\n", what);
    std::exit(1);
}

oc_ray down(double x, double y) { return make_ray(V3{x, y, 10}, V3{0, 0, -1}, 0); }

} // namespace

int main() {
    // Two squares of two triangles each, at z = 1 (triangles 0 and 1) and z = 0 (2 and 3), and a sliver at z = 2.
    Mesh mesh;
    for (float z : {1.0f, 0.0f}) {
        for (float p : {0.0f, 0.0f, z, 1.0f, 0.0f, z, 1.0f, 1.0f, z, 0.0f, 1.0f, z}) mesh.positions.push_back(p);
    }
    for (float p : {2.0f, 0.0f, 2.0f, 3.0f, 0.0f, 2.0f, 3.0f, 1e-3f, 2.0f}) mesh.positions.push_back(p);
    for (std::uint32_t i : {0, 1, 2, 0, 2, 3, 4, 5, 6, 4, 6, 7, 8, 9, 10}) mesh.indices.push_back(i);
    mesh.positions.push_back(0);
    const Agreement judge(mesh);
    const Answer miss{false, 0, 0};

    const oc_ray inside = down(0.75, 0.25);
    expect(judge.judge(inside, Answer{true, 9, 0}, true) == Verdict::RIGHT, "the closest hit is right");
    expect(judge.judge(inside, Answer{true, 10, 2}, true) == Verdict::WRONG, "a hit behind the closest is wrong");
    expect(judge.judge(inside, Answer{true, 10, 2}, false) == Verdict::RIGHT, "a shadow is a shadow");
    expect(judge.judge(inside, Answer{true, 8.5, 0}, true) == Verdict::WRONG, "a wrong distance is wrong");
    expect(judge.judge(inside, miss, true) == Verdict::WRONG && judge.judge(inside, miss, false) == Verdict::WRONG, "a miss through a surface is wrong");

    const oc_ray outside = down(1.5, 0.5);
    expect(judge.judge(outside, miss, true) == Verdict::RIGHT, "a miss of nothing is right");
    expect(judge.judge(outside, Answer{true, 9, 0}, true) == Verdict::WRONG && judge.judge(outside, Answer{true, 9, 0}, false) == Verdict::WRONG,
           "a hit of nothing is wrong");

    // On the border, both are right; a rounding beside it, one is right and the other is excused.
    const oc_ray border = down(1, 0.5);
    expect(judge.judge(border, miss, true) == Verdict::RIGHT && judge.judge(border, Answer{true, 9, 0}, true) == Verdict::RIGHT, "an edge may be hit or missed");
    const oc_ray beside = down(1 + 1.2e-7, 0.5), within = down(1 - 6e-8, 0.5);
    expect(judge.judge(beside, miss, true) == Verdict::RIGHT && judge.judge(beside, Answer{true, 9, 0}, true) == Verdict::ROUNDING, "a hit beside an edge");
    expect(judge.judge(within, Answer{true, 9, 0}, true) == Verdict::RIGHT && judge.judge(within, miss, true) == Verdict::ROUNDING, "a miss beside an edge");

    // The diagonal belongs to both triangles; neither side may fall through it.
    const oc_ray diagonal = down(0.5, 0.5);
    expect(judge.judge(diagonal, Answer{true, 9, 0}, true) == Verdict::RIGHT && judge.judge(diagonal, Answer{true, 9, 1}, true) == Verdict::RIGHT, "a shared edge");
    expect(judge.judge(diagonal, miss, true) != Verdict::RIGHT && judge.judge(diagonal, Answer{true, 10, 2}, true) != Verdict::RIGHT, "a crack in a shared edge");

    // A sliver is hit where it is, and not beside it.
    expect(judge.judge(down(2.5, 2.5e-4), Answer{true, 8, 4}, true) == Verdict::RIGHT, "a sliver that is hit");
    expect(judge.judge(down(2.5, 2.5e-4), miss, true) == Verdict::WRONG, "a sliver that is missed");
    expect(judge.judge(down(2.5, 7.5e-4), Answer{true, 8, 4}, true) == Verdict::WRONG, "a hit beside a sliver");

    // The end of the interval.
    oc_ray ends = down(0.75, 0.25);
    ends.t_max = 9;
    expect(judge.judge(ends, miss, false) == Verdict::RIGHT && judge.judge(ends, Answer{true, 9, 0}, false) == Verdict::RIGHT, "a hit at the end of the interval");
    ends.t_max = 8.5;
    expect(judge.judge(ends, Answer{true, 9, 0}, false) == Verdict::WRONG, "a hit behind the end of the interval");
    return 0;
}
