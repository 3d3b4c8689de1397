// The only table of topics. docs/topics.md explains it. The DDS layer reads the quality of service from it. No other
// code holds a topic name.
#pragma once

#include <array>
#include <string_view>

#include "messages/messages.hpp"

namespace softhand::bus {

enum class Reliability { best_effort, reliable };
enum class Durability { volatile_, transient_local };
enum class Writers {
  any,        ///< samples of all writers are delivered
  one,        ///< a reader follows one writer of each key (FollowedWriter), and refuses stamps that are not usable
  strongest,  ///< only samples of the strongest live writer of a key are delivered
};

struct TopicRow {
  std::string_view name;
  const char* type;  ///< DDS type name, from idl/
  Reliability reliability;
  Durability durability;
  int depth;          ///< samples kept per instance (history: keep last)
  int max_instances;  ///< largest number of instances (different keys) of a writer
  int deadline_ms;    ///< per instance; 0 = none
  int liveliness_ms;  ///< lease, asserted by the process; 0 = the lease of the process (10 s)
  int lifespan_ms;    ///< older samples are no longer delivered; 0 = samples stay as long as the history keeps them
  Writers writers;    ///< what a reader does if several writers write an instance
  double rate_hz;     ///< nominal; 0 = on demand
  std::string_view writer;
  std::string_view readers;
  /// The last sample of a writer that ends arrives, too: the zero command of a device. It does on every topic on
  /// demand.
  bool last_matters = false;
};

/// A row and the C++ struct of its samples.
template <typename T>
struct Topic : TopicRow {
  using Type = T;
};

namespace topics {

inline constexpr auto best_effort = Reliability::best_effort;
inline constexpr auto reliable = Reliability::reliable;
inline constexpr auto vol = Durability::volatile_;
inline constexpr auto late = Durability::transient_local;
inline constexpr auto any = Writers::any;
inline constexpr auto one = Writers::one;
inline constexpr auto strongest = Writers::strongest;
inline constexpr int kHands = 32;  ///< 16 users
inline constexpr int kSoftObjects = static_cast<int>(kMaxSoftObjects);

// clang-format off
// Three lines per row: first the variable, then the topic name and type. The third line has the other members of
// TopicRow: reliability, durability, depth, max_instances, deadline_ms, liveliness_ms, lifespan_ms, writers,
// rate_hz, writer, readers, last_matters.
inline constexpr Topic<Skeleton> tracked_skeleton{{
    "softhand/v1/tracked_skeleton", "softhand::v1::Skeleton",
    best_effort, vol,  1, kHands, 50, 50,   0, strongest, 90, "trackers", "tracking, hand (direct), viewer, recorder"}};
inline constexpr Topic<Skeleton> intermediate_skeleton{{
    "softhand/v1/intermediate_skeleton", "softhand::v1::Skeleton",
    best_effort, vol,  1, kHands,  0,  0,    0, one,    1000, "tracking", "hand, viewer, recorder"}};
inline constexpr Topic<Skeleton> simulated_skeleton{{
    "softhand/v1/simulated_skeleton", "softhand::v1::Skeleton",
    best_effort, vol,  1, kHands,  0,  0,    0, one,       90, "hand", "tracking, viewer, recorder"}};
inline constexpr Topic<TissueSurface> tissue_surface{{
    "softhand/v1/tissue_surface", "softhand::v1::TissueSurface",
    best_effort, vol,  1, kHands,  0,  0,    0, one,       90, "hand", "viewer, recorder"}};
inline constexpr Topic<Contacts> contacts{{
    "softhand/v1/contacts", "softhand::v1::Contacts",
    best_effort, vol,  1, kHands,  0,  0,    0, one,       90, "hand", "tracking, viewer, recorder"}};
inline constexpr Topic<SkinTraction> skin_traction{{
    "softhand/v1/skin_traction", "softhand::v1::SkinTraction",
    best_effort, vol,  1, kHands,  0,  0,    0, one,       90, "hand", "tactile, viewer, recorder"}};
inline constexpr Topic<WorldObjects> objects{{
    "softhand/v1/objects", "softhand::v1::WorldObjects",
    best_effort, vol,  1, 16,      0,  0,    0, one,      250, "world", "hand, viewer, recorder"}};
inline constexpr Topic<ObjectCoupling> object_coupling{{
    "softhand/v1/object_coupling", "softhand::v1::ObjectCoupling",
    best_effort, vol,  1, kHands,  0,  0,    0, one,       90, "hand", "world, other hands, viewer, recorder"}};
inline constexpr Topic<BoneWrench> bone_wrench{{
    "softhand/v1/bone_wrench", "softhand::v1::BoneWrench",
    best_effort, vol,  1, kHands,  0,  0,    0, one,   1000, "tracking, hand (direct)", "haptics, viewer, recorder"}};
inline constexpr Topic<DeviceState> device_state{{
    "softhand/v1/device_state", "softhand::v1::DeviceState",
    best_effort, vol,  1, 64,      0,  0,    0, one,    1000, "haptics, tactile", "cli, recorder", true}};
inline constexpr Topic<HeadPose> head_pose{{
    "softhand/v1/head_pose", "softhand::v1::HeadPose",
    best_effort, vol,  1, 16,      0,  0,    0, one,       90, "trackers", "tracking, hand (direct), recorder"}};
inline constexpr Topic<Message> message{{
    "softhand/v1/message", "softhand::v1::Message",
    reliable,   late, 64, 1,       0,  0, 2000, any,        0, "anyone", "every module"}};
inline constexpr Topic<MessageReply> message_reply{{
    "softhand/v1/message_reply", "softhand::v1::MessageReply",
    reliable,   late, 64, 1,       0,  0, 2000, any,        0, "every module", "the asker"}};
inline constexpr Topic<LoopStatus> loop_status{{
    "softhand/v1/loop_status", "softhand::v1::LoopStatus",
    reliable,   vol,  4, 64,      0,  0,    0, any,       10, "every module", "cli, viewer, recorder"}};
inline constexpr Topic<RigChoices> rig_choices{{
    "softhand/v1/rig_choices", "softhand::v1::RigChoices",
    reliable,   late, 1, 16,      0,  0,    0, any,        0, "softhand up", "cli, viewer, recorder"}};
inline constexpr Topic<ClockBeacon> clock_beacon{{
    "softhand/v1/clock_beacon", "softhand::v1::ClockBeacon",
    best_effort, vol, 16, 1,       0,  0,    0, any,       10, "every module", "every module, recorder"}};
inline constexpr Topic<ObjectDescription> object_description{{
    "softhand/v1/object_description", "softhand::v1::ObjectDescription",
    reliable,   late, 1, 256,     0,  0,    0, any,        0, "world", "hand, viewer, recorder"}};
inline constexpr Topic<ObjectJointDescription> object_joint{{
    "softhand/v1/object_joint", "softhand::v1::ObjectJointDescription",
    reliable,   late, 1, 256,     0,  0,    0, any,        0, "world", "hand, recorder"}};
inline constexpr Topic<SoftObjectDescription> soft_object_description{{
    "softhand/v1/soft_object_description", "softhand::v1::SoftObjectDescription",
    reliable,   late, 1, kSoftObjects, 0, 0, 0, any,        0, "hand", "viewer, world, recorder"}};
inline constexpr Topic<SoftObjectState> soft_object_state{{
    "softhand/v1/soft_object_state", "softhand::v1::SoftObjectState",
    best_effort, vol,  1, kSoftObjects, 0, 0, 0, one,      90, "hand", "viewer, cli, world, recorder"}};
inline constexpr Topic<SoftObjectState> soft_object_copy{{
    "softhand/v1/soft_object_copy", "softhand::v1::SoftObjectState",
    best_effort, vol,  1, kSoftObjects, 0, 0, 0, one,     100, "world", "hand, recorder"}};
inline constexpr Topic<HandDescription> hand_description{{
    "softhand/v1/hand_description", "softhand::v1::HandDescription",
    reliable,   late, 1, kHands,  0,  0,    0, any,        0, "hand", "viewer, recorder"}};
// clang-format on

/// Calls f(topic) for every row.
template <typename F>
void for_each(F&& f) {
  f(tracked_skeleton), f(intermediate_skeleton), f(simulated_skeleton), f(tissue_surface), f(contacts),
      f(skin_traction), f(objects), f(object_coupling), f(bone_wrench);
  f(device_state), f(head_pose), f(message), f(message_reply), f(loop_status), f(rig_choices), f(clock_beacon),
      f(object_description), f(object_joint), f(soft_object_description), f(soft_object_state), f(soft_object_copy),
      f(hand_description);
}

}  // namespace topics
}  // namespace softhand::bus
