# Parts of the program that fuzzers and sanitizers take apart from the rest: what reads files and packets, and what
# a haptic tick runs. They see no world, so physics is not built for them as a whole.
set(SERVER ${PROJECT_SOURCE_DIR}/server)
set(PHYSICS ${PROJECT_SOURCE_DIR}/physics)
file(GLOB reader_sources CONFIGURE_DEPENDS ${SERVER}/mesh/mesh_re*.cpp)
list(APPEND reader_sources ${SERVER}/mesh/foreign_format.cpp ${SERVER}/mesh/mesh_unit.cpp
     ${SERVER}/files/yaml_keys.cpp ${SERVER}/scene/device_reader.cpp ${SERVER}/scene/scene_reader.cpp
     ${SERVER}/scene/scene_bodies.cpp ${SERVER}/scene/scene_parts.cpp ${SERVER}/scene/scene_instruments.cpp
     ${SERVER}/record/trajectory.cpp ${SERVER}/record/trajectory_reader.cpp
     ${SERVER}/record/bag_reader.cpp ${SERVER}/record/ros2_messages.cpp
     ${PHYSICS}/tissue/surface.cpp ${PHYSICS}/tissue/mesh_quality.cpp)
file(GLOB tick_sources CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/haptic/*.cpp
     ${PROJECT_SOURCE_DIR}/haptic/contact/*.cpp ${PHYSICS}/contact/*.cpp
     ${PHYSICS}/contact/candidates/*.cpp
     ${PHYSICS}/contact/cutting/*.cpp ${PHYSICS}/contact/distance/*.cpp
     ${PHYSICS}/contact/incision/*.cpp ${PHYSICS}/contact/solver/*.cpp)
# The kernels for any processor alone.
list(APPEND tick_sources ${PHYSICS}/compliance/factor/front_kernels.cpp
     ${PHYSICS}/compliance/factor/front_kernels_generic.cpp)
