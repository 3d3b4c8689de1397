#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <sstream>

#include "model/hand_model.hpp"
#include "support/block_hand.hpp"

namespace softhand {
namespace {

using testing::block_hand;

std::string temporary(const std::string& name) { return ::testing::TempDir() + name; }

std::string contents(const std::string& path) {
  std::ifstream in(path);
  std::stringstream text;
  text << in.rdbuf();
  return text.str();
}

TEST(Skeleton, BodiesAndJointsMatch) {
  for (int b = 2; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    EXPECT_EQ(body_of(joint_of(body)), body);
    EXPECT_EQ(kBodyNames[static_cast<std::size_t>(b)], kJointNames[static_cast<std::size_t>(index_of(joint_of(body)))]);
  }
  EXPECT_EQ(body_of(Joint::wrist), Body::carpus);
  EXPECT_EQ(body_of(Joint::ring_tip), Body::ring_distal);
  EXPECT_EQ(parent_of(Body::thumb_metacarpal), Body::carpus);
  EXPECT_EQ(parent_of(Body::little_metacarpal), Body::carpus);
  EXPECT_EQ(parent_of(Body::index_intermediate), Body::index_proximal);
  EXPECT_EQ(end_joint_of(Body::thumb_distal), Joint::thumb_tip);
  EXPECT_EQ(finger_of(Body::middle_distal), Finger::middle);
  EXPECT_EQ(tip_of(Finger::little), Joint::little_tip);
  EXPECT_EQ(distal_of(Finger::thumb), Body::thumb_distal);
  EXPECT_EQ(distal_of(Finger::little), Body::little_distal);
}

TEST(HandFile, RoundTripGivesTheSameBytes) {
  const std::string first = temporary("first.hand.json");
  const std::string second = temporary("second.hand.json");
  save_hand(block_hand(), first);
  save_hand(load_hand(first), second);
  EXPECT_TRUE(contents(first) == contents(second)) << "compare " << first << " with " << second;
}

TEST(HandFile, KeepsGeometryToItsGrid) {
  HandModel hand = block_hand();
  hand.materials[0].strain_limit_ramp = 0.25;
  const std::string path = temporary("grid.hand.json");
  save_hand(hand, path);
  const HandModel back = load_hand(path);
  ASSERT_EQ(back.nodes.size(), hand.nodes.size());
  for (std::size_t n = 0; n < hand.nodes.size(); ++n) EXPECT_LE((back.nodes[n] - hand.nodes[n]).norm(), 1e-7);
  EXPECT_EQ(back.tetrahedra, hand.tetrahedra);
  EXPECT_EQ(back.surface, hand.surface);
  EXPECT_EQ(back.materials[0].strain_limit_ramp, 0.25);
  EXPECT_EQ(back.bodies[7].joint.kind, hand.bodies[7].joint.kind);
}

struct Fault {
  const char* name;
  std::function<void(HandModel&)> corrupt;
  const char* field;
};

class HandValidation : public ::testing::TestWithParam<Fault> {};

TEST_P(HandValidation, NamesFileAndField) {
  HandModel hand = block_hand();
  ASSERT_NO_THROW(validate(hand, "good"));
  GetParam().corrupt(hand);
  try {
    validate(hand, "spoilt.hand.json");
    FAIL() << "accepted";
  } catch (const std::invalid_argument& error) {
    EXPECT_NE(std::string(error.what()).find("spoilt.hand.json"), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find(GetParam().field), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find("expected"), std::string::npos) << error.what();
  }
}

INSTANTIATE_TEST_SUITE_P(
    Faults, HandValidation,
    ::testing::Values(
        Fault{"NotANumber", [](HandModel& h) { h.nodes[3].y() = std::nan(""); }, "nodes[3]"},
        Fault{"Millimetres",
              [](HandModel& h) {
                for (Vector3& x : h.nodes) x *= 1000;
              },
              "nodes[0]"},
        Fault{"Inverted", [](HandModel& h) { std::swap(h.tetrahedra[5][0], h.tetrahedra[5][1]); }, "tetrahedra[5]"},
        Fault{"Flat",
              [](HandModel& h) {
                h.nodes[static_cast<std::size_t>(h.tetrahedra[0][3])] =
                    h.nodes[static_cast<std::size_t>(h.tetrahedra[0][2])];
              },
              "tetrahedra["},
        Fault{"UnusedNode",
              [](HandModel& h) {
                h.nodes.emplace_back(0, 0, 0);
                h.node_body.push_back(0);
              },
              "nodes["},
        Fault{"NodeOutOfRange", [](HandModel& h) { h.tetrahedra[1][0] = 1 << 20; }, "tetrahedra[1]"},
        Fault{"Poisson", [](HandModel& h) { h.materials[0].poisson_ratio = 0.5; }, "materials[0].poisson_ratio"},
        Fault{"StrainLimit", [](HandModel& h) { h.materials[0].strain_limit_energy = 0; },
              "materials[0].strain_limit_energy"},
        Fault{"StrainLimitNaN", [](HandModel& h) { h.materials[0].strain_limit_energy = std::nan(""); },
              "materials[0].strain_limit_energy"},
        Fault{"StrainLimitRamp", [](HandModel& h) { h.materials[0].strain_limit_ramp = 1.5; },
              "materials[0].strain_limit_ramp"},
        Fault{"Massless", [](HandModel& h) { h.bodies[4].mass = 0; }, "bodies[thumb_distal].mass"},
        Fault{"IndefiniteInertia", [](HandModel& h) { h.bodies[4].inertia(1, 1) = -1e-6; },
              "bodies[thumb_distal].inertia"},
        Fault{"LimitsCrossed",
              [](HandModel& h) {
                h.bodies[8].joint.flexion_range = {0.3, -0.3};
              },
              "bodies[index_distal].joint.flexion_range"},
        Fault{"FingerCap", [](HandModel& h) { h.bodies[8].coupling_force_cap = 19; }, "bodies.coupling.force_cap"},
        Fault{"NoForceCap", [](HandModel& h) { h.bodies[8].coupling_force_cap = 0; },
              "bodies[index_distal].coupling.force_cap"},
        Fault{"NoTorqueCap", [](HandModel& h) { h.bodies[8].coupling_torque_cap = 0; },
              "bodies[index_distal].coupling.torque_cap"},
        Fault{"AttachmentWeights", [](HandModel& h) { h.attachments[2].weights[0] += 0.1; }, "attachment_weights[2]"},
        Fault{"NoContactPoints", [](HandModel& h) { h.contact_points.clear(); },
              "contact_tetrahedron: expected at least"},
        Fault{"ContactTetrahedron", [](HandModel& h) { h.contact_points[3].tetrahedron = 1 << 20; },
              "contact_tetrahedron[3]"},
        Fault{"ContactWeights", [](HandModel& h) { h.contact_points[2].weights[0] += 0.1; }, "contact_weights[2]"},
        Fault{"ContactWeightNegative",
              [](HandModel& h) {
                h.contact_points[2].weights = {-0.1, 1.1, 0, 0};
              },
              "contact_weights[2]"},
        Fault{"ContactArea", [](HandModel& h) { h.contact_points[1].area = 0; }, "contact_area[1]"},
        Fault{"ContactAreaNaN", [](HandModel& h) { h.contact_points[1].area = std::nan(""); }, "contact_area[1]"},
        Fault{"ContactBody", [](HandModel& h) { h.contact_points[1].body = 21; }, "contact_body[1]"},
        Fault{"SkinVertices", [](HandModel& h) { h.skin_vertices.resize(20001, h.skin_vertices[0]); },
              "skin_tetrahedron: expected at most 20000, got 20001"},
        Fault{"SkinTriangles", [](HandModel& h) { h.skin_triangles.resize(40001, h.skin_triangles[0]); },
              "skin_triangles: expected at most 40000, got 40001"},
        Fault{"Wrist", [](HandModel& h) { h.rest_joints[1].position.x() = 0.01; }, "joints[wrist]"}),
    [](const auto& instance) { return std::string(instance.param.name); });

TEST(HandFile, RefusesBrokenTextUnknownFieldsAndWrongVersions) {
  const std::string path = temporary("broken.hand.json");
  save_hand(block_hand(), path);
  const std::string good = contents(path);
  const auto refused = [&path](const std::string& text, const std::string& word) {
    std::ofstream(path) << text;
    try {
      load_hand(path);
      ADD_FAILURE() << "accepted; expected an error about " << word;
    } catch (const std::runtime_error& error) {
      EXPECT_NE(std::string(error.what()).find(path), std::string::npos);
      EXPECT_NE(std::string(error.what()).find(word), std::string::npos) << error.what();
    }
  };
  const auto replaced = [&good](const std::string& from, const std::string& to) {
    std::string text = good;
    const auto at = text.find(from);
    EXPECT_NE(at, std::string::npos);
    return text.replace(at, from.size(), to);
  };
  refused(good.substr(0, good.size() / 2), "not a hand file");
  refused(replaced("\"version\": 2", "\"version\": 1"), "version: expected 2");
  refused(replaced("\"contact_weights\": [", "\"contact_weights\": [0,1,0,0,"), "contact_weights: expected four items");
  refused(replaced("\"contact_area\": [", "\"contact_area\": [1e-5,"), "contact_area: expected as many items");
  refused(replaced("\"contact_body\": [", "\"contact_body\": [0,"), "contact_body: expected as many items");
  const auto line = good.find("\"contact_body\"");
  refused(std::string(good).erase(line, good.find('\n', line) + 1 - line), "contact_body: missing");
  refused(replaced("\"units\": \"m ", "\"units\": \"mm "), "units");
  refused(replaced("\"notice\"", "\"colour\": 3,\n\"notice\""), "colour");
  refused(replaced("\"mass\"", "\"colour\":3,\"mass\""), "bodies[0].colour: unknown field");
  refused(replaced("\"bone\":{", "\"bone\":{\"colour\":3,"), "bodies[0].bone.colour: unknown field");
  refused(replaced("\"joint\":{", "\"joint\":{\"colour\":3,"), "bodies[0].joint.colour: unknown field");
  refused(replaced("\"coupling\":{", "\"coupling\":{\"colour\":3,"), "bodies[0].coupling.colour: unknown field");
  const auto bone = good.find("\"bone\":") + 7;
  refused(std::string(good).replace(bone, good.find('}', bone) + 1 - bone, "3"), "bodies[0].bone: expected an object");
  refused(replaced("\"kind\":\"hinge\"", "\"kind\":\"slider\""), "joint.kind");
  refused(replaced("\"mass\":0.02", "\"mass\":\"light\""), "mass");
  refused(replaced("\"mass\":0.02", "\"mass\":1e999"), "not a hand file");
  EXPECT_THROW(load_hand("/nonexistent/x.hand.json"), std::runtime_error);
  try {
    load_hand("/tmp");
    ADD_FAILURE() << "accepted a folder as a hand file";
  } catch (const std::runtime_error& error) {
    EXPECT_STREQ(error.what(), "/tmp: cannot be opened");
  }
}

TEST(HandFile, DropsNodesThatNoTetrahedronUses) {
  const std::string path = temporary("loose.hand.json");
  const HandModel good = block_hand();
  HandModel loose = good;
  loose.nodes.insert(loose.nodes.begin() + 7, Vector3(0.01, 0.02, 0.03));
  loose.node_body.insert(loose.node_body.begin() + 7, std::uint8_t{3});
  loose.nodes.emplace_back(0, 0, 0);
  loose.node_body.push_back(0);
  const auto shift = [](auto& list) {
    for (auto& nodes : list) {
      for (std::int32_t& node : nodes) node += node >= 7 ? 1 : 0;
    }
  };
  shift(loose.tetrahedra);
  shift(loose.surface);
  save_hand(loose, path);
  const HandModel read = load_hand(path);
  EXPECT_EQ(read.tetrahedra, good.tetrahedra);
  EXPECT_EQ(read.surface, good.surface);
  EXPECT_EQ(read.node_body, good.node_body);
  ASSERT_EQ(read.nodes.size(), good.nodes.size());
  for (std::size_t n = 0; n < good.nodes.size(); ++n) EXPECT_LE((read.nodes[n] - good.nodes[n]).norm(), 1e-9) << n;
}

TEST(Mirrored, TwiceGivesTheSameHandAndOnceAValidOne) {
  const HandModel hand = block_hand();
  const HandModel left = mirrored(hand);
  EXPECT_EQ(left.side, Side::left);
  EXPECT_NO_THROW(validate(left, "left"));
  // The thumb lies at -X on a right hand and at +X on a left one. Dorsal stays +Y.
  EXPECT_GT(left.rest_joints[static_cast<std::size_t>(index_of(Joint::thumb_tip))].position.x(), 0);
  const Quaternion thumb = left.rest_joints[static_cast<std::size_t>(index_of(Joint::thumb_metacarpal))].orientation;
  EXPECT_GT((thumb * Vector3::UnitY()).y(), 0.99);
  for (std::size_t p = 0; p < hand.contact_points.size(); ++p) {
    const Vector3 right = hand.position_of(hand.contact_points[p]), mirror = left.position_of(left.contact_points[p]);
    EXPECT_LE((mirror - Vector3(-right.x(), right.y(), right.z())).norm(), 1e-12);
  }
  const HandModel back = mirrored(left);
  for (std::size_t n = 0; n < hand.nodes.size(); ++n) EXPECT_EQ(back.nodes[n], hand.nodes[n]);
  EXPECT_EQ(back.tetrahedra, hand.tetrahedra);
  for (std::size_t b = 0; b < kBodyCount; ++b) EXPECT_TRUE(back.bodies[b].inertia.isApprox(hand.bodies[b].inertia));
}

TEST(Fitted, TakesTheUsersBoneLengthsInAnyPose) {
  const HandModel hand = block_hand(2);
  // The user's hand is 10 % longer and in another pose.
  std::array<Pose, kJointCount> frame;
  const Pose elsewhere{Vector3(0.3, 1.1, -0.4), Quaternion(Eigen::AngleAxisd(0.8, Vector3(1, 2, 3).normalized()))};
  for (std::size_t j = 0; j < kJointCount; ++j) {
    frame[j] = elsewhere * Pose{1.1 * hand.rest_joints[j].position, hand.rest_joints[j].orientation};
  }
  std::array<double, kJointCount> radii;
  radii.fill(0.011);
  const HandModel fit = fitted(hand, measure_skeleton(std::span(&frame, 1), radii));
  for (std::size_t j = 0; j < kJointCount; ++j) {
    EXPECT_LE((fit.rest_joints[j].position - 1.1 * hand.rest_joints[j].position).norm(), 1e-9) << kJointNames[j];
  }
  for (std::size_t n = 0; n < hand.nodes.size(); ++n) {
    if (hand.nodes[n].z() > -0.05) continue;  // the wrist end stays
    EXPECT_GT(std::abs(fit.nodes[n].z()), std::abs(hand.nodes[n].z()));
  }
}

TEST(Fitted, TheSameSkeletonChangesNothing) {
  const HandModel hand = block_hand(2);
  const HandModel same = fitted(hand, measure_skeleton(std::span(&hand.rest_joints, 1), hand.joint_radii));
  for (std::size_t n = 0; n < hand.nodes.size(); ++n) EXPECT_LE((same.nodes[n] - hand.nodes[n]).norm(), 1e-12);
  for (std::size_t b = 0; b < kBodyCount; ++b) EXPECT_NEAR(same.bodies[b].mass, hand.bodies[b].mass, 1e-12);
}

TEST(Fitted, RefusesABoneOfImpossibleLength) {
  const HandModel hand = block_hand();
  MeasuredSkeleton user = measure_skeleton(std::span(&hand.rest_joints, 1), hand.joint_radii);
  user.offsets[static_cast<std::size_t>(index_of(Joint::index_tip))] *= 3;
  EXPECT_THROW(fitted(hand, user), std::invalid_argument);
}

}  // namespace
}  // namespace softhand
