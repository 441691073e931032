# What every room's CMakeLists uses: wb_library, wb_test, and the project's compiler flags.

add_compile_options(-Wall -Wextra -Wpedantic -Wno-unused-parameter)
# Warnings are errors for the project's own code; generated IDL code relaxes this for itself.
option(WB_WERROR "treat warnings as errors" ON)
if(WB_WERROR)
  add_compile_options(-Werror)
endif()
add_compile_options(-march=x86-64-v3)
# GCC's array-bounds analysis reports false positives inside Eigen 3.4's fixed-maximum-size products.
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  add_compile_options(-Wno-array-bounds -Wno-stringop-overflow -Wno-stringop-overread -Wno-maybe-uninitialized)
endif()

# Headers that nearly every source includes, parsed once: for libraries and plugins, and for programs (with GoogleTest). GCC
# wants the same code model and the same definitions in both places, so neither target has any of its own. Preset tidy does
# without: there each source has to name what it includes.
set(headers <Eigen/Core> <Eigen/Geometry> <algorithm> <array> <atomic> <cmath> <cstdint> <filesystem> <functional> <map> <memory>
  <optional> <random> <span> <sstream> <string> <thread> <vector>)
add_library(wb_headers OBJECT ${CMAKE_CURRENT_LIST_DIR}/headers.cpp)
target_link_libraries(wb_headers PRIVATE Eigen3::Eigen)
target_precompile_headers(wb_headers PRIVATE ${headers})
add_library(wb_program_headers OBJECT ${CMAKE_CURRENT_LIST_DIR}/headers.cpp)
set_target_properties(wb_program_headers PROPERTIES POSITION_INDEPENDENT_CODE OFF)
target_compile_options(wb_program_headers PRIVATE -fPIE)
target_link_libraries(wb_program_headers PRIVATE Eigen3::Eigen GTest::gtest)
target_precompile_headers(wb_program_headers PRIVATE ${headers} <gtest/gtest.h>)

# wb_library(NAME SOURCES ... DEPENDS ...): static library wb_NAME whose headers are included from the root.
function(wb_library name)
  cmake_parse_arguments(ARG "" "" "SOURCES;DEPENDS" ${ARGN})
  add_library(wb_${name} STATIC ${ARG_SOURCES})
  target_include_directories(wb_${name} PUBLIC ${CMAKE_SOURCE_DIR})
  target_link_libraries(wb_${name} PUBLIC Eigen3::Eigen ${ARG_DEPENDS})
  target_precompile_headers(wb_${name} REUSE_FROM wb_headers)
endfunction()

# wb_plugin(NAME SOURCES ... DEPENDS ...): driver plugin lib wb_driver_NAME. Nothing but the entry point leaves it: its copy
# of core must not meet the host's.
function(wb_plugin name)
  cmake_parse_arguments(ARG "" "" "SOURCES;DEPENDS" ${ARGN})
  add_library(wb_driver_${name} MODULE ${ARG_SOURCES})
  target_link_libraries(wb_driver_${name} PRIVATE ${ARG_DEPENDS})
  target_link_options(wb_driver_${name} PRIVATE -Wl,--exclude-libs,ALL -Wl,--no-undefined)
  set_target_properties(wb_driver_${name} PROPERTIES CXX_VISIBILITY_PRESET hidden VISIBILITY_INLINES_HIDDEN ON
    LIBRARY_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/drivers)
endfunction()

# wb_test(NAME SOURCES ... DEPENDS ... LABELS ...): one GoogleTest program; ctest sees each of its tests.
# Labels, several if need be:
#   fast         the default; runs under asan-ubsan, too
#   scenario     a daemon in lockstep
#   process      waits for other programs or threads in real time: scripts/test runs these one by one
#   sanitized    as good as `fast` under asan-ubsan, but long or in real time: ctest --test-dir build/asan-ubsan -L sanitized
#   concurrency  has threads; runs under tsan, too
# Targets fast_tests, sanitized_tests, concurrent_tests: what those need. Under tsan the suppressions of tests/sanitizers apply.
include(GoogleTest)
add_custom_target(fast_tests)
add_custom_target(sanitized_tests)
add_custom_target(concurrent_tests)
function(wb_test name)
  cmake_parse_arguments(ARG "" "TIMEOUT" "SOURCES;DEPENDS;LABELS" ${ARGN})
  if(NOT ARG_LABELS)
    set(ARG_LABELS fast)
  endif()
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 120)
  endif()
  add_executable(${name} ${ARG_SOURCES})
  target_link_libraries(${name} PRIVATE ${ARG_DEPENDS} GTest::gtest GTest::gtest_main)
  target_precompile_headers(${name} REUSE_FROM wb_program_headers)
  target_compile_definitions(${name} PRIVATE WB_SOURCE_DIR="${CMAKE_SOURCE_DIR}" WB_BUILD_DIR="${CMAKE_BINARY_DIR}")
  set(sanitizer_labels fast sanitized concurrency)
  set(sanitizer_targets fast_tests sanitized_tests concurrent_tests)
  foreach(label target IN ZIP_LISTS sanitizer_labels sanitizer_targets)
    if(label IN_LIST ARG_LABELS)
      add_dependencies(${target} ${name})
    endif()
  endforeach()
  # A list would fall apart on its way through gtest_discover_tests; ctest -L matches parts of a label, too.
  list(JOIN ARG_LABELS "-" labels)
  gtest_discover_tests(${name} DISCOVERY_MODE PRE_TEST PROPERTIES LABELS ${labels} TIMEOUT ${ARG_TIMEOUT}
    ENVIRONMENT TSAN_OPTIONS=suppressions=${CMAKE_SOURCE_DIR}/tests/sanitizers/tsan.supp)
endfunction()
