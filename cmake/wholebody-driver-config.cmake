# For driver plugins built outside the tree: wholebody::driver brings <wholebody/driver.h>.
if(NOT TARGET wholebody::driver)
  add_library(wholebody::driver INTERFACE IMPORTED)
  get_filename_component(_wholebody_prefix "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
  set_target_properties(wholebody::driver PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${_wholebody_prefix}/include")
endif()
