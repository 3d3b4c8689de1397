// The binary frames between gateway and page. docs/viewer.md has every layout. Little-endian, SI units, world frame as
// on the topics.
//
// A frame is a header of 16 bytes and a payload. Both lengths are multiples of 4. The header:
//   u32 magic "SHVF", u16 version, u16 type, u32 payload bytes, u32 instance
// A WebSocket message from the gateway is one or more frames. A message to the gateway is exactly one frame. `instance`
// distinguishes hands (2 * user + side), objects (id), flexible objects (id minus kFirstSoftObject) and modules (slot).
// A newer frame replaces an older one of the same type and instance, except for message_reply.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <variant>
#include <vector>

#include "math/types.hpp"
#include "messages/messages.hpp"
#include "model/object_model.hpp"
#include "model/triangle_mesh.hpp"

namespace softhand::viewer {

inline constexpr std::uint32_t kMagic = 0x46564853;  ///< "SHVF"
inline constexpr std::uint16_t kVersion = 3;
inline constexpr std::size_t kHeaderBytes = 16;

enum class FrameType : std::uint16_t {
  hand_description = 1,
  nodes = 2,
  tracked_skeleton = 3,
  intermediate_skeleton = 4,
  simulated_skeleton = 5,
  contacts = 6,
  objects = 7,
  object_description = 8,
  bone_wrench = 9,
  loop_status = 10,
  message_reply = 11,
  gateway = 12,
  rig_choices = 13,
  soft_object_description = 14,
  soft_object_nodes = 15,
  prompt = 16,
  // from the page
  show = 32,
  message = 33,
};

/// The set of frame types that a page shows.
using TypeSet = std::uint32_t;
constexpr TypeSet set_of(FrameType type) { return TypeSet{1} << static_cast<unsigned>(type); }
/// The types that a page can request. `gateway` is sent without a request.
inline constexpr TypeSet kShowable = ((set_of(FrameType::message_reply) << 1) - set_of(FrameType::hand_description)) |
                                     set_of(FrameType::rig_choices) | set_of(FrameType::soft_object_description) |
                                     set_of(FrameType::soft_object_nodes) | set_of(FrameType::prompt);

/// An encoded frame. Null if the content must not be shown (NaN or infinity). It is shared because several pages get
/// it.
using Frame = std::shared_ptr<const std::vector<std::uint8_t>>;

constexpr std::uint32_t instance_of(const HandKey& hand) { return 2 * hand.user + hand.side; }

/// `rest_nodes` (m, rest frame) let the page compute the strain of the skin. Empty = unknown.
Frame encode(const HandDescription& description, std::span<const Vector3> rest_nodes);
/// `quantised`: int16 fractions of the largest coordinate (about 5 um on a hand) instead of float32.
Frame encode(const TissueSurface& surface, bool quantised);
Frame encode(FrameType which, const Skeleton& skeleton);
Frame encode(const Contacts& contacts);
/// Returns null for a `world` above 65535.
Frame encode(const WorldObjects& objects);
/// `mesh`: the link of an object file in its own frame, else null. Returns null for a description of a file without it,
/// and for a `world` or an id above 65535.
Frame encode(const ObjectDescription& description, const TriangleMesh* mesh = nullptr);
Frame encode(const BoneWrench& wrench);
/// The surface of the flexible object, as in a hand's description. `body`: of its file. Null if `removed` is set: the
/// frame then has no nodes. Returns null if the description has another number of nodes than the body, or a wrong id.
Frame encode(const SoftObjectDescription& description, const SoftBody* body);
/// As for a hand, relative to the centre of mass. Returns null for a wrong id.
Frame encode(const SoftObjectState& state, bool quantised);
/// `slot`: the instance number of the module.
Frame encode(const LoopStatus& status, std::uint32_t slot);
Frame encode(const MessageReply& reply, std::uint32_t slot);
Frame encode(const RigChoices& choices, std::uint32_t slot);

/// What a person is asked to do, for a time.
struct Prompt {
  double seconds = 0;
  ShortText text{};  ///< empty: nothing any more
};
/// Reads the value of the message `prompt`: the seconds, 0 to 600, a space, and the text. Empty if it is anything else.
std::optional<Prompt> read_prompt(std::string_view value);
Frame encode(const Prompt& prompt);

/// Draws an object that a hand owns at the pose of the hand's twin, because the world's copy lags behind it
/// (docs/coupling-objects.md). Hands hold only objects of a rig's world.
void draw_held(WorldObjects& objects, const ObjectCoupling& coupling);

/// Reason why a frame from a page was refused.
enum class Refusal : std::uint8_t { none, size, magic, version, type, content, origin, flood, token };
inline constexpr std::array<std::string_view, 9> kRefusalNames{"none",    "size",   "magic", "version", "type",
                                                               "content", "origin", "flood", "token"};
using RefusalCounts = std::array<std::uint64_t, kRefusalNames.size()>;

/// State of the gateway, sent every half second.
struct GatewayState {
  Nanoseconds clock = 0;    ///< monotonic; with it the page computes ages
  std::uint64_t epoch = 0;  ///< of this start of the gateway
  std::uint32_t pages = 0;
  std::uint32_t rate_hz = 0;
  std::uint64_t bytes_sent = 0;
  std::uint64_t frames_sent = 0;
  std::uint64_t frames_passed_over = 0;  ///< replaced by newer ones, or of too many streams, for a slow page
  std::uint64_t refused_content = 0;     ///< samples of topics with values that are not finite
  RefusalCounts refused{};
};
Frame encode(const GatewayState& state);

/// A request of a page: the types that it shows, and their rate.
struct ShowRequest {
  TypeSet types = 0;
  float rate_hz = 0;  ///< Hz, upper limit for the frames of a stream; 0 = `viewer.rate_hz`
};
using PageRequest = std::variant<ShowRequest, Message>;
/// Decodes a frame from a page. Sizes, versions, numbers and texts are checked, so any input is safe. `out` is written
/// only if the result is `none`.
Refusal decode(std::span<const std::uint8_t> bytes, PageRequest& out);

}  // namespace softhand::viewer
