#include "wall/report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>

#include "report/report.hpp"
#include "wall/virtual_wall.hpp"

namespace softhand::wall {

constexpr double kSwing = 0.01;  // m

int run_wall(const WallArguments& arguments) {
  std::string text;
  const auto print = [&text](const std::string& row) {
    fmt::print("{}", row);
    std::fflush(stdout);
    text += row;
  };
  print(
      "| device | age of the input, ms | held, stable: N/m | touched: N/m | near: N/m | near over held | five times "
      "held: "
      "N/m | its lowest energy, mJ | its ripple, mm | felt, N/m |\n"
      "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n");
  bool good = true;
  for (const Device& device : kDevices) {
    for (const double age : {0.005, 0.011, 0.02, 0.03}) {
      Link link;
      link.age = age;
      const double held = largest_stiffness(device, link, Mode::held, false);
      const double touched = largest_stiffness(device, link, Mode::touched, true);
      const double near = largest_stiffness(device, link, Mode::near, true);
      const Result five = worst({device, {}, link, 5 * held, Mode::near, 0});
      print(fmt::format("| {} | {:.0f} | {:.0f} | {:.0f} | {:.0f} | {:.1f} | {:.0f} | {:.2f} | {:.3f} | {:.0f} |\n",
                        device.name, 1e3 * age, held, touched, near, near / held, 5 * held, 1e3 * five.lowest_energy,
                        1e3 * five.ripple, five.rendered));
      if (age == Link{}.age) good = good && five.passive() && five.stable();
    }
  }
  print(
      "\n| device | wall, N/m | held: lowest energy, mJ; felt, N/m | touched | near |\n"
      "| --- | --- | --- | --- | --- |\n");
  for (const Device& device : kDevices) {
    for (const double stiffness : {100.0, 200.0, 400.0, 800.0, 1600.0, 3200.0}) {
      std::string row = fmt::format("| {} | {:.0f} |", device.name, stiffness);
      for (const Mode mode : {Mode::held, Mode::touched, Mode::near}) {
        const Result r = worst({device, {}, {}, stiffness, mode, 0});
        row += fmt::format(" {:.2f}; {:.0f} |", 1e3 * r.lowest_energy, r.rendered);
      }
      print(row + "\n");
    }
  }
  print(
      "\n| device | delay, ms | positions missing | near, commands assumed: N/m | known: N/m | four times its "
      "stiffness, "
      "assumed: lowest energy, mJ | known: mJ |\n"
      "| --- | --- | --- | --- | --- | --- | --- |\n");
  for (const Device& device : kDevices) {
    for (const int delay : {0, 1, 2}) {
      for (const double missing : {0.0, 0.1, 0.5}) {
        const Path assumed{.delay = delay, .missing = missing}, known{delay, missing, false, true};
        const auto largest = [&](const Path& path) { return largest_stiffness(device, {}, Mode::near, true, path); };
        const auto lowest = [&](const Path& path) {
          return 1e3 *
                 worst({device, {}, {}, std::min(4 * device.stiffness, 10000.0), Mode::near, 0, path}).lowest_energy;
        };
        print(fmt::format("| {} | {} | {:.0f} % | {:.0f} | {:.0f} | {:.1f} | {:.1f} |\n", device.name, delay,
                          100 * missing, largest(assumed), largest(known), lowest(assumed), lowest(known)));
      }
    }
  }
  print(
      "\n| device | wall, N/m | Hz | hand | without velocity: force error, N; lowest energy, mJ | with velocity |\n"
      "| --- | --- | --- | --- | --- | --- |\n");
  for (const Device& device : kDevices) {
    const double stiffness = std::min(device.stiffness, 800.0);
    for (const double frequency : {1.0, 2.0}) {
      for (const bool is_carried : {false, true}) {
        std::string row = fmt::format("| {} | {:.0f} | {:.0f} | {} |", device.name, stiffness, frequency,
                                      is_carried ? "moves with the wall" : "stays");
        for (const bool tells : {false, true}) {
          const Swing swing{kSwing, frequency, is_carried, tells};
          const Result r = worst({device, {}, {}, stiffness, Mode::near, 0, {}, swing});
          row += fmt::format(" {:.2f}; {:.2f} |", r.force_error, 1e3 * r.lowest_energy);
          if (tells) good = good && r.passive();
        }
        print(row + "\n");
      }
    }
  }
  report::write_file(arguments.markdown, text);
  return good ? 0 : 1;
}

}  // namespace softhand::wall
