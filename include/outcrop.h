/* outcrop: ray traces models larger than memory on the CPU.
 *
 * SPDX-License-Identifier: MIT OR Apache-2.0
 *
 * This file is generated: change src/capi and run `make header`.
 *
 * Rules that hold everywhere
 *
 * Status.    Every call that can fail returns an oc_status. Outputs are written only when it is
 *            OC_STATUS_OK. oc_last_error() has the reason in words.
 * Structs    that you fill begin with `struct_size`: OC_INIT(&s), or oc_init(&s, sizeof s) where
 *            there are no macros, zeroes a struct and sets it. Zero means the default everywhere.
 * Objects    are counted: whoever gets one through an `out_` parameter owns one count, gives it
 *            back with oc_*_release, and may add one with oc_*_retain. Releasing NULL does
 *            nothing. An object keeps alive what it was made from. Objects of two contexts never
 *            mix.
 * const      means that the object does not change; calls that take it const may run at the same
 *            time in any threads. Others say so under `Thread safety`.
 * Pointers   may be NULL only where that is said. A count of 0 ignores its pointer. A stride is in
 *            bytes, 0 means tightly packed; no alignment beyond that of bytes is asked for.
 * Strings    are UTF-8 and end with 0. Paths are the bytes that the system takes.
 * Units      are the model's own; angles say theirs; colours are linear, not sRGB.
 * Matrices   are affine, 12 doubles by column: x axis, y axis, z axis, origin.
 * Blocking.  Calls marked `Cheap` never wait for the disk or for other work. Those marked
 *            `Blocks` do; where the context has no threads, they do the work themselves.
 */


#ifndef OUTCROP_H
#define OUTCROP_H

#include <stddef.h>
#include <stdint.h>

#if defined(_WIN32) && !defined(OC_STATIC)
#define OC_API __declspec(dllimport)
#elif defined(__GNUC__) && !defined(OC_STATIC)
#define OC_API __attribute__((visibility("default")))
#else
#define OC_API
#endif

/** Zeroes the struct at `pointer` and sets its size: `oc_camera c; OC_INIT(&c);`. */
#define OC_INIT(pointer) oc_init((pointer), sizeof *(pointer))


/**
 * Major version: programs built for another one do not work.
 */
#define OC_VERSION_MAJOR 0

/**
 * Minor version: while the major version is 0, programs built for another one do not work.
 */
#define OC_VERSION_MINOR 1

/**
 * Patch version.
 */
#define OC_VERSION_PATCH 0

/**
 * The version of this header, `major * 10000 + minor * 100 + patch`: pass it to
 * `oc_context_create`.
 */
#define OC_HEADER_VERSION 100

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * The version of the library, to be compared with `OC_HEADER_VERSION`.
 *
 * Thread safety: any thread. Cheap.
 */
OC_API uint32_t oc_version(void);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* OUTCROP_H */
