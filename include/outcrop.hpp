// outcrop for C++11: handles over outcrop.h that release themselves.
//
// SPDX-License-Identifier: MIT OR Apache-2.0
#ifndef OUTCROP_HPP
#define OUTCROP_HPP

#include "outcrop.h"

#endif // OUTCROP_HPP
