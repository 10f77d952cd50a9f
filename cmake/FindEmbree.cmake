# Finds Embree 4 or 3.13, with or without Embree's own package files.
#
# Defines Embree_FOUND, Embree_VERSION_MAJOR and the imported target Embree::Embree, whose users
# see EMBREE_MAJOR as a compile definition.
foreach(major 4 3)
  if(NOT Embree_INCLUDE_DIR)
    find_path(Embree_INCLUDE_DIR embree${major}/rtcore.h)
    find_library(Embree_LIBRARY NAMES embree${major})
    if(Embree_INCLUDE_DIR AND Embree_LIBRARY)
      set(Embree_VERSION_MAJOR ${major} CACHE STRING "major version of Embree")
    else()
      unset(Embree_INCLUDE_DIR CACHE)
      unset(Embree_LIBRARY CACHE)
    endif()
  endif()
endforeach()
mark_as_advanced(Embree_INCLUDE_DIR Embree_LIBRARY Embree_VERSION_MAJOR)

include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(Embree REQUIRED_VARS Embree_LIBRARY Embree_INCLUDE_DIR)

if(Embree_FOUND AND NOT TARGET Embree::Embree)
  add_library(Embree::Embree UNKNOWN IMPORTED)
  set_target_properties(Embree::Embree PROPERTIES
    IMPORTED_LOCATION "${Embree_LIBRARY}"
    INTERFACE_INCLUDE_DIRECTORIES "${Embree_INCLUDE_DIR}"
    INTERFACE_COMPILE_DEFINITIONS "EMBREE_MAJOR=${Embree_VERSION_MAJOR}")
endif()
