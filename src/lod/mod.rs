//! Stand-ins: voxels and proxies, and the bookkeeping of their accuracy. Nothing of this version makes any:
//! every hit is exact. What the other rooms already say of them is `math::Cone`, `HitKind` and the `error` of a hit.
//! Uses base and math.
#![forbid(unsafe_code)]
