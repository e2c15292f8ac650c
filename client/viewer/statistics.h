#pragma once
// What the statistics overlay shows: the figures, and as lines of text.
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "client/viewer/accuracy.h"

namespace client {

std::string_view accuracyName(Accuracy accuracy);  ///< "blended"

struct Statistics {
  double frames_per_second = 0.0;      ///< of the last second; 0 at rest
  double frame_milliseconds = 0.0;     ///< to draw one, smoothed; 0 when the platform gave no clock
  std::uint32_t images_in_use = 0;     ///< blended in the picture
  std::uint32_t images_resident = 0;   ///< on the GPU
  std::uint32_t images_requested = 0;  ///< here and on their way to the GPU
  std::uint32_t patches = 0;
  std::uint64_t triangles = 0;
  std::uint64_t memory_bytes = 0, memory_budget = 0;  ///< all that grows with the scene, GPU and memory together
  std::uint64_t gpu_bytes = 0;                        ///< of these, textures and buffers
  std::uint64_t received_bytes = 0;
  std::uint64_t received_images = 0, received_patches = 0, received_frames = 0;  ///< bytes of each kind
  double megabits_per_second = 0.0;                                              ///< received in the last second
  double round_trip_milliseconds = 0.0;  ///< from a view's leaving to the first answer; 0: not measured yet
  double error_px = 0.0;                 ///< largest projected error of the patches drawn, or splat
  double hit_rate = 0.0;                 ///< of the images that moving views used, the share that was here, 0 … 1
  Accuracy accuracy = Accuracy::kNothing;
  std::uint64_t splats = 0;  ///< drawn
  double reduction = 1.0;    ///< pixels a side for each sample that was drawn
  double lens_px = 0.0;      ///< as error_px, through the magnifying glass; 0: there is none
  bool limited = false;      ///< memory forbids finer splats
  std::uint64_t blocks = 0;  ///< of the file of splats; 0: none is shown
  std::uint64_t blocks_present = 0, blocks_requested = 0, blocks_wanted = 0;
  bool complete = false;     ///< all for this view is here and shown
  std::uint32_t broken = 0;  ///< pieces that could not be decoded
  std::string last_fault;
};

struct StatisticsLine {
  std::string name;   ///< "images"
  std::string value;  ///< "12 in use, 30 resident, 2 requested"
};
std::vector<StatisticsLine> statisticsLines(const Statistics& statistics);

}  // namespace client
