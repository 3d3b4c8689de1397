#include <fmt/format.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>

#include "cli/commands.hpp"
#include "cli/virtual_rig.hpp"
#include "messages/convert.hpp"
#include "scene_file.hpp"
#include "viewer/recording.hpp"

namespace softhand {
namespace {

namespace fs = std::filesystem;

// Runs a program until it ends and returns its exit code.
int run_to_end(const std::vector<std::string>& command) {
  std::vector<char*> argv;
  for (const std::string& word : command) argv.push_back(const_cast<char*>(word.c_str()));
  argv.push_back(nullptr);
  const pid_t child = fork();
  if (child < 0) throw std::runtime_error(std::string("cannot start a process: ") + std::strerror(errno));
  if (child == 0) {
    execvp(argv[0], argv.data());
    std::fprintf(stderr, "softhand render: cannot start %s: %s\n", argv[0], std::strerror(errno));
    _exit(127);
  }
  int status = 0;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  return WIFEXITED(status) ? WEXITSTATUS(status) : 1;
}

// Runs the scene on the virtual clock. Records the frames that the page would receive, from 0.2 s before `arguments.at`
// on.
void record(const RenderArguments& arguments, const std::string& path) {
  constexpr double kBefore = 0.2;  // s, so that every stream has delivered a frame before the first picture
  std::vector<std::string> overrides = arguments.overrides;
  if (!arguments.hand.empty()) overrides.push_back("hand.model=" + arguments.hand);
  const Scene scene = read_scene(arguments.scene, overrides);
  const HandModel hand = load_scene_hand(scene);
  VirtualRig rig(
      scene, hand,
      std::make_unique<ReplayTracker>(make_scene_motion(scene, hand), scene.options.tracker, hand_key(scene)));
  rig.add_other_hands(scene, overrides);
  viewer::Recording recording(path);
  for (std::size_t i = 0; i < rig.hand_count(); ++i) {
    const int in_loop = rig.number_in_loop(i);
    const auto described = std::make_unique<HandDescription>(rig.hand(i).description(in_loop));
    recording.add(0, viewer::encode(*described, rig.hand(i).simulation().hand(in_loop).nodes));
  }
  for (std::size_t i = 0; i < rig.world().descriptions().size(); ++i) {
    const ObjectOptions& object = scene.options.objects[i];
    recording.add(0, viewer::encode(rig.world().descriptions()[i],
                                    object.model == nullptr ? nullptr : &object.model->links[object.link].mesh));
  }
  const std::vector<SoftObjectDescription> soft = rig.hand().soft_object_descriptions();
  for (std::size_t i = 0; i < soft.size(); ++i)
    recording.add(0, viewer::encode(soft[i], scene.soft_objects[i].body.get()));
  auto objects = std::make_unique<WorldObjects>();
  rig.run(arguments.at + arguments.seconds + kBefore, [&](const HandStepView& view) {
    const double time = static_cast<double>(view.time - VirtualRig::kStart) * 1e-9;
    if (time < arguments.at - kBefore) return;
    const double since = time - arguments.at + kBefore;
    *objects = *view.objects;
    viewer::draw_held(*objects, *view.coupling);
    recording.add(since, viewer::encode(viewer::FrameType::tracked_skeleton, *view.tracked));
    recording.add(since, viewer::encode(viewer::FrameType::simulated_skeleton, view.output->simulated));
    recording.add(since, viewer::encode(*objects));
    recording.add(since, viewer::encode(view.output->contacts));
    recording.add(since, viewer::encode(view.output->surface, false));
    for (const SoftObjectState& each : view.output->soft_objects) recording.add(since, viewer::encode(each, false));
  });
  recording.close();
}

}  // namespace

int run_render(const RenderArguments& arguments) {
  const fs::path share = fs::read_symlink("/proc/self/exe").parent_path().parent_path() / "share/softhand";
  const fs::path script = share / "renderer/render.mjs";
  if (!fs::exists(script))
    throw std::runtime_error(script.string() + " is missing: built with SOFTHAND_VIEWER=OFF, or without npm");
  const bool outputs_recording = fs::path(arguments.out).extension() == ".shv";
  const std::string recording =
      outputs_recording ? arguments.out
                        : (fs::temp_directory_path() / fmt::format("softhand_render_{}.shv", getpid())).string();
  record(arguments, recording);
  if (outputs_recording) return 0;
  const int code = run_to_end({"node", script.string(), recording, arguments.out, fmt::format("{}", arguments.width),
                               fmt::format("{}", arguments.height), fmt::format("{}", arguments.seconds),
                               fmt::format("{}", arguments.pictures_per_second), arguments.view});
  fs::remove(recording);
  return code == 0 ? 0 : 1;
}

}  // namespace softhand
