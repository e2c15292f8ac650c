# `cmake --install` installs the programs, and the browser client's files where `lumigrid serve` and `publish` look for
# them. The preset "web" builds those files (another compiler, so another build folder); without them the server shows a
# plain page.
include(GNUInstallDirs)
set(LUMIGRID_PAGE_FILES "${PROJECT_SOURCE_DIR}/build/web/site" CACHE PATH
  "Folder with the browser client's files, as the preset web builds them")

install(TARGETS lumigrid lumigrid-view RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
if(LUMIGRID_COMPARE)
  install(TARGETS lumigrid-compare RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
endif()
install(DIRECTORY "${LUMIGRID_PAGE_FILES}/" DESTINATION share/lumigrid/web OPTIONAL)
