// RT_SAFE marks steps and ports: noexcept, and under the rtsan preset (clang) checked not to
// allocate, lock or call the kernel.
#pragma once

#if defined(__clang__) && defined(__has_cpp_attribute)
#if __has_cpp_attribute(clang::nonblocking)
#define RT_SAFE noexcept [[clang::nonblocking]]
#endif
#endif
#ifndef RT_SAFE
#define RT_SAFE noexcept
#endif
