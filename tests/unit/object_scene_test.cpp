// Scenes with object files: their links and joints, the world's compounds and planes, and the shapes of the hand.
#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <thread>

#include "hand/object_shapes.hpp"
#include "messages/convert.hpp"
#include "scene_file.hpp"
#include "world/world_loop.hpp"

namespace softhand::object_scene_test {
namespace {

namespace fs = std::filesystem;

const std::string kConfig = SOFTHAND_SOURCE_DIR "/config/";

class ObjectScene : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("softhand_object_scene_" + std::to_string(getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  std::string write(const std::string& text) const {
    const fs::path path = folder_ / "scene.toml";
    std::ofstream(path) << text;
    return path.string();
  }
  std::string complaint(const std::string& text) const {
    try {
      const Scene scene = read_scene(write(text));
      std::string wrong;
      for (const std::string& each :
           check_world(scene.options.world, scene.options.objects, 1.0 / 90, scene.options.joints))
        wrong += each;
      return wrong;
    } catch (const std::exception& error) {
      return error.what();
    }
  }
  fs::path folder_;
};

const std::string kMug =
    "[[objects]]\nname = \"cup\"\nshape = \"file\"\nfile = \"" + kConfig + "objects/mug.object.json\"\n";
const std::string kTable = "[[objects]]\nname = \"table\"\nhalf_extents = [0.4, 0.02, 0.4]\nposition = [0, -0.02, 0]\n";

TEST_F(ObjectScene, AFileBringsItsLinksAndJoints) {
  const Scene scene = read_scene(kConfig + "scenes/drawer.toml");
  const auto& objects = scene.options.objects;
  ASSERT_EQ(objects.size(), 2u);
  EXPECT_EQ(objects[0].name, "drawer.housing");
  EXPECT_EQ(objects[0].mass, 0) << "the root is fixed";
  EXPECT_EQ(objects[1].name, "drawer.tray");
  EXPECT_NEAR(objects[1].mass, 1.303, 0.001);
  EXPECT_EQ(scene.options.hand.mirrored_objects, 1);
  EXPECT_EQ(scene.options.hand.object_joints, 1);
  WorldLoop world(scene.options.world, objects, 1.0 / 90, scene.options.joints);
  for (int i = 1; i <= 100; ++i) world.step(i * 4'000'000, {});
  EXPECT_NEAR(world.joint_coordinate("drawer.tray"), 0, 1e-4);
  EXPECT_LT(world.joint_gap("drawer.tray"), 1e-4);
}

const std::string kBall =
    "[[objects]]\nname = \"ball\"\nshape = \"file\"\nfile = \"" + kConfig + "objects/sponge_ball.object.json\"\n";

TEST_F(ObjectScene, FlexibleObjectsBelongToTheHandAndNotToTheWorld) {
  const Scene scene = read_scene(write(kTable + kBall + "position = [0, 0.1, 0]\n"));
  EXPECT_EQ(scene.options.objects.size(), 1u);
  ASSERT_EQ(scene.soft_objects.size(), 1u);
  EXPECT_EQ(scene.soft_objects[0].name, "ball");
  EXPECT_EQ(scene.soft_objects[0].pose.position, Vector3(0, 0.1, 0));
  EXPECT_EQ(scene.soft_objects[0].gravity, Vector3(0, -9.81, 0));
  EXPECT_EQ(scene.options.hand.mirrored_objects, 0);
  EXPECT_EQ(scene.options.hand.static_objects, 1);
}

TEST_F(ObjectScene, OfSeveralHandsTheFirstSimulatesTheFlexibleObjects) {
  const std::string path =
      write(kTable + kBall + "position = [0, 0.1, 0]\n[[hands]]\nname = \"right\"\n[[hands]]\nname = \"left\"\n");
  EXPECT_EQ(read_scene(path).soft_objects.size(), 1u);
  EXPECT_EQ(read_scene(path, {"plays=right"}).soft_objects.size(), 1u);
  EXPECT_EQ(read_scene(path, {"plays=left"}).soft_objects.size(), 0u);
}

TEST_F(ObjectScene, RefusesWhatAFlexibleObjectCannotHave) {
  EXPECT_NE(complaint(kBall + "mass = 1\n").find("objects.ball.mass: the object is flexible"), std::string::npos);
  EXPECT_NE(complaint(kBall + "fixed = true\n").find("objects.ball.fixed"), std::string::npos);
  EXPECT_NE(complaint(kBall + "floating = true\n").find("objects.ball.floating"), std::string::npos);
  EXPECT_NE(complaint(kBall + "orientation = [1, 1, 0, 0]\n").find("objects.ball.orientation"), std::string::npos);
  EXPECT_NE(complaint(kBall + kBall).find("objects.ball: the name is used twice"), std::string::npos);
  EXPECT_NE(complaint("[world]\nsoft = \"engine\"\n" + kBall).find("world.soft"), std::string::npos);
}

TEST_F(ObjectScene, ASpringThatWouldGrowOnASharedFlexibleObjectIsRefused) {
  const auto reasons = [&](const std::string& world) {
    const Scene scene = read_scene(write("[world]\nmode = \"symmetric\"\n" + world + kTable + kBall));
    return check_soft_objects(scene.options.world, scene.soft_objects, 1 / scene.options.hand.rate_hz);
  };
  EXPECT_TRUE(reasons("stiffness = 5000\ndamping_ratio = 0\n").empty()) << "the hand owns it, there is no spring";
  const auto refused = reasons("soft = \"world\"\nstiffness = 5000\ndamping_ratio = 0\n");
  ASSERT_EQ(refused.size(), 1u);
  EXPECT_NE(refused[0].find("world.stiffness = 5000: small deviations grow by a factor of"), std::string::npos);
  EXPECT_NE(refused[0].find("on objects.ball (0.00"), std::string::npos) << refused[0];
  const std::string offer = "The nearest value that works: ";
  const std::size_t at = refused[0].find(offer);
  if (at != std::string::npos) {
    const double works = std::stod(refused[0].substr(at + offer.size()));
    EXPECT_TRUE(
        reasons("soft = \"world\"\nstiffness = " + std::to_string(0.99 * works) + "\ndamping_ratio = 0\n").empty());
  } else {
    EXPECT_NE(refused[0].find("No stiffness works"), std::string::npos);
  }
  const Scene scene =
      read_scene(write("[world]\nmode = \"symmetric\"\nsoft = \"world\"\nstiffness = 5000\n"
                       "damping_ratio = 0\n" +
                       kTable + kBall));
  EXPECT_THROW(WorldLoop(scene.options.world, scene.options.objects, 1.0 / 90, {}, scene.soft_objects),
               std::invalid_argument);
}

TEST_F(ObjectScene, OneLinkHasTheNameOfItsEntry) {
  const Scene scene = read_scene(write(kMug));
  ASSERT_EQ(scene.options.objects.size(), 1u);
  EXPECT_EQ(scene.options.objects[0].name, "cup");
  WorldLoop world(scene.options.world, scene.options.objects);
  const ObjectDescription& description = world.descriptions()[0];
  ASSERT_EQ(description.shape.file.size(), 1u);
  EXPECT_EQ(get_text(description.shape.file[0].name), "mug");
  EXPECT_EQ(get_text(description.shape.file[0].sha256).size(), 64u);
  EXPECT_TRUE(description.shape.vertices.empty());
}

// The base of the mug consists of many pieces. Each has the same plane of the table, which must count once.
TEST_F(ObjectScene, AMugOnATableStandsStillAndHasOnePlane) {
  const Scene scene = read_scene(write(kTable + kMug));
  WorldLoop world(scene.options.world, scene.options.objects);
  ObjectCoupling coupling;
  ObjectTwin twin;
  twin.object = 2;
  Nanoseconds now = 0;
  for (int i = 1; i <= 250; ++i) {
    now += 4'000'000;
    coupling.stamp.sample_time = now;
    coupling.twins.clear();
    coupling.twins.push_back(twin);
    world.step(now, {std::span(&coupling, 1)});
  }
  const ObjectState& mug = world.objects().objects[1];
  const double start = world.objects().objects[1].position[1];
  EXPECT_NEAR(start, 0.0397702, 2e-4);
  EXPECT_LT(to_vector(mug.linear_velocity).norm(), 1e-3);
  ASSERT_EQ(mug.planes.size(), 1u);
  EXPECT_NEAR(mug.planes[0].normal[1], 1, 1e-3);
  EXPECT_NEAR(mug.planes[0].gap, 0, 5e-4);
}

// A ball in the mug touches its inside, so the world must not close the mug with a hull.
TEST_F(ObjectScene, ABallFallsIntoTheMug) {
  const Scene scene = read_scene(write(kTable + kMug +
                                       "[[objects]]\nname = \"ball\"\nshape = \"sphere\"\nradius = 0.01\nmass = 0.01\n"
                                       "position = [0, 0.08, 0]\n"));
  WorldLoop world(scene.options.world, scene.options.objects);
  for (int i = 1; i <= 500; ++i) world.step(i * 4'000'000, {});
  EXPECT_LT(world.objects().objects[2].position[1], 0.03);
}

TEST_F(ObjectScene, RefusesWhatCannotRun) {
  const std::pair<std::string, std::string> cases[]{
      {"[[objects]]\nshape = \"file\"\n", "objects.object.file: expected a name"},
      {"[[objects]]\nshape = \"file\"\nfile = \"nothing\"\n", "no file 'nothing.object.json'"},
      {kMug + "mass = 1\n", "objects.cup.mass: the object file gives the mass"},
      {"[[objects]]\nfile = \"mug\"\n", "objects.object.file: expected shape = \"file\""},
      {"[[objects]]\nfixed = true\n", "objects.object.fixed: for object files only"},
      {kMug + "fixed = true\nfloating = true\n", ""},
  };
  for (const auto& [text, expected] : cases) {
    const std::string got = complaint(text);
    EXPECT_NE(got.find(expected), std::string::npos) << got << "\nexpected: " << expected;
  }
}

ObjectDescription described_mug(const Scene& scene) {
  WorldLoop world(scene.options.world, scene.options.objects);
  return world.descriptions()[0];
}

TEST_F(ObjectScene, ShapesAreLoadedBesideTheLoop) {
  const Scene scene = read_scene(write(kMug));
  const ObjectDescription mug = described_mug(scene);
  ObjectShapes shapes(object_folders(scene));
  shapes.request(mug);
  int waits = 0;
  std::shared_ptr<const ShapeGeometry> shape;
  const auto take = [&](const ObjectDescription& d, std::shared_ptr<const ShapeGeometry> got) {
    EXPECT_EQ(d.object, mug.object);
    shape = std::move(got);
  };
  const auto complain = [](const ObjectDescription&, const std::string& problem) { ADD_FAILURE() << problem; };
  for (; shape == nullptr && waits < 3000; ++waits) {
    shapes.deliver(take, complain);
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  ASSERT_NE(shape, nullptr);
  EXPECT_GT(waits, 1) << "sampling the grid must not block";
  // The wall of the mug is 4 mm thick. Its inside is empty.
  const ShapeFile& file = mug.shape.file[0];
  const Pose to_body = to_pose(file.position, file.orientation);
  EXPECT_LT(shape->signed_distance(to_body * Vector3(0, 0.05, 0.038)), -0.001);
  EXPECT_GT(shape->signed_distance(to_body * Vector3(0, 0.05, 0)), 0.03);
  EXPECT_GT(shape->signed_distance(to_body * Vector3(0.054, 0.05, 0)), 0.01) << "the loop of the handle is open";
}

// A hull with many vertices takes longer than a step may take.
TEST(ObjectShapes, HullsAreBuiltBesideTheLoop) {
  ObjectDescription ball, flat, box;
  ball.object = 1, flat.object = 2, box.object = 3;
  ball.shape.kind = flat.shape.kind = static_cast<std::uint32_t>(ShapeKind::convex_hull);
  box.shape.kind = static_cast<std::uint32_t>(ShapeKind::box);
  box.shape.size = {0.1, 0.1, 0.1};
  for (int i = 0; i < 200; ++i) {
    const double y = -1 + (2 * i + 1) / 200.0, r = std::sqrt(1 - y * y), turn = 2.4 * i;
    ball.shape.vertices.push_back({0.05 * r * std::cos(turn), 0.05 * y, 0.05 * r * std::sin(turn)});
  }
  for (int i = 0; i < 4; ++i) flat.shape.vertices.push_back({0.1 * i, 0, 0});
  ObjectShapes shapes({});
  std::map<std::uint32_t, std::shared_ptr<const ShapeGeometry>> taken;
  std::map<std::uint32_t, std::string> refused;
  const auto deliver = [&] {
    shapes.deliver([&](const ObjectDescription& d, auto shape) { taken[d.object] = std::move(shape); },
                   [&](const ObjectDescription& d, const std::string& problem) { refused[d.object] += problem; });
  };
  for (const ObjectDescription* each : {&ball, &flat, &box}) shapes.request(*each);
  for (int i = 0; i < 3000 && taken.size() + refused.size() < 3; ++i) {
    deliver();
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  ASSERT_TRUE(taken.count(1) == 1 && taken[1] != nullptr);
  EXPECT_NEAR(taken[1]->signed_distance(Vector3(0.1, 0, 0)), 0.05, 0.003);
  ASSERT_EQ(refused.count(2), 1u) << "four points on a line are no hull";
  EXPECT_FALSE(refused[2].empty());
  ASSERT_EQ(taken.count(3), 1u);
  EXPECT_EQ(taken[3], nullptr) << "a box is quickly built";
}

TEST_F(ObjectScene, AWrongHashIsRefusedAndNamedOnce) {
  const Scene scene = read_scene(write(kMug));
  ObjectDescription mug = described_mug(scene);
  mug.shape.file[0].sha256[0] = mug.shape.file[0].sha256[0] == '0' ? '1' : '0';
  ObjectShapes shapes(object_folders(scene));
  EXPECT_THROW(shapes.prepare(mug.shape), std::runtime_error);
  int refused = 0;
  std::string text;
  for (int round = 0; round < 2; ++round) {
    shapes.request(mug);
    for (int i = 0; i < 3000 && refused == round; ++i) {
      shapes.deliver([](const ObjectDescription&, const auto&) { ADD_FAILURE() << "a wrong file was accepted"; },
                     [&](const ObjectDescription&, const std::string& problem) {
                       ++refused;
                       text += problem;
                     });
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
  }
  EXPECT_EQ(refused, 2);
  EXPECT_NE(text.find("mug.object.json: has the SHA-256"), std::string::npos) << text;
  EXPECT_EQ(text.find("has the SHA-256"), text.rfind("has the SHA-256")) << "named twice: " << text;
}

}  // namespace
}  // namespace softhand::object_scene_test
