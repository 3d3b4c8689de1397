// softhand-tactile-log: a simulated tactile glove that logs its contact events.
#include "service/device_service.hpp"
#include "tactile/log/tactile_log_driver.hpp"

int main(int argc, char** argv) {
  using namespace softhand;
  return run_device<TactileLogDriver>(argc, argv, "tactile-log",
                                      [](const SceneOptions& scene) -> const TactileOptions& { return scene.tactile; });
}
