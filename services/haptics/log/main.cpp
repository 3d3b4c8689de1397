// softhand-haptic-log: a simulated force-feedback glove that logs its input.
#include "haptics/log/haptic_log_driver.hpp"
#include "service/device_service.hpp"

int main(int argc, char** argv) {
  using namespace softhand;
  return run_device<HapticLogDriver>(argc, argv, "haptic-log",
                                     [](const SceneOptions& scene) -> const HapticOptions& { return scene.haptic; });
}
