/* cyclone_subscriber DOMAIN TOPIC [HASH]: reads one sample of a softhand topic with Cyclone DDS. Prints some fields by
 * name. HASH is that of the topic in idl/hashes.txt: the endpoints carry it, and writers with another one are printed.
 * Then it writes the whole sample on TOPIC_echo, until the reader there has it (standard input closes) or 20 s have
 * passed. At last it disposes the instance. This shows the other vendor's view of the wire. */
#include <inttypes.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bone_wrench.h"
#include "clock.h"
#include "contacts.h"
#include "coupling.h"
#include "dds/dds.h"
#include "descriptions.h"
#include "device.h"
#include "head_pose.h"
#include "message.h"
#include "objects.h"
#include "skeleton.h"
#include "soft_objects.h"
#include "status.h"
#include "tissue.h"
#include "traction.h"

static void print_skeleton(const void* sample) {
  const softhand_v1_Skeleton* s = sample;
  printf("hand.side %" PRIu32 "\nstamp.sample_time %" PRId64 "\nconfidence %.17g\n", s->hand.side, s->stamp.sample_time,
         s->confidence);
  printf("joints[25].orientation.w %.17g\njoints[25].radius %.17g\n", s->joints[25].orientation.w,
         s->joints[25].radius);
}
static void print_contacts(const void* sample) {
  const softhand_v1_Contacts* s = sample;
  if (s->contacts._length == 0) return;
  const softhand_v1_Contact* last = &s->contacts._buffer[s->contacts._length - 1];
  printf("fingers[5].area %.17g\ncontacts.length %" PRIu32 "\n", s->fingers[5].area, s->contacts._length);
  printf("contacts[last].force.z %.17g\ncontacts[last].slip_speed %.17g\n", last->force.z, last->slip_speed);
}
static void print_traction(const void* sample) {
  const softhand_v1_SkinTraction* s = sample;
  if (s->regions._length == 0) return;
  const softhand_v1_SkinRegion* last = &s->regions._buffer[s->regions._length - 1];
  printf("regions.length %" PRIu32 "\nregions[last].shear.y %.9g\nregions[last].area_rate %.9g\n", s->regions._length,
         last->shear.y, last->area_rate);
}
static void print_objects(const void* sample) {
  const softhand_v1_WorldObjects* s = sample;
  if (s->objects._length == 0) return;
  const softhand_v1_ObjectState* last = &s->objects._buffer[s->objects._length - 1];
  printf("objects.length %" PRIu32 "\nobjects[last].position.y %.17g\n", s->objects._length, last->position.y);
  if (last->planes._length == 0) return;
  printf("objects[last].planes[last].mass %.17g\n", last->planes._buffer[last->planes._length - 1].mass);
}
static void print_wrench(const void* sample) {
  const softhand_v1_BoneWrench* s = sample;
  printf("bones[20].coupling_torque.y %.17g\n", s->bones[20].coupling_torque.y);
}
static void print_status(const void* sample) {
  const softhand_v1_LoopStatus* s = sample;
  printf("module_name %s\nstep_ms_p99 %.17g\n", s->module_name, s->step_ms_p99);
  printf("passivity_energy %.17g\n", s->passivity_energy);
  if (s->ledger._length > 0) printf("ledger[last].value %.17g\n", s->ledger._buffer[s->ledger._length - 1].value);
}
static void print_choices(const void* sample) {
  const softhand_v1_RigChoices* s = sample;
  if (s->choices._length == 0) return;
  const softhand_v1_RigChoice* last = &s->choices._buffer[s->choices._length - 1];
  printf("choices.length %" PRIu32 "\nchoices[last].choice %s\nchoices[last].running %" PRIu32 "\n", s->choices._length,
         last->choice, last->running);
}
static void print_soft_object(const void* sample) {
  const softhand_v1_SoftObjectState* s = sample;
  printf("object_id %" PRIu32 "\nowned %" PRIu32 "\nnodes.length %" PRIu32 "\n", s->object_id, s->owned,
         s->nodes._length);
  if (s->velocities._length > 0)
    printf("velocities[last].z %.9g\n", s->velocities._buffer[s->velocities._length - 1].z);
}
static void print_nothing(const void* sample) { (void)sample; }

static const struct {
  const char* topic;
  const dds_topic_descriptor_t* type;
  void (*print)(const void* sample);
} kinds[] = {
    {"softhand/v1/tracked_skeleton", &softhand_v1_Skeleton_desc, print_skeleton},
    {"softhand/v1/intermediate_skeleton", &softhand_v1_Skeleton_desc, print_skeleton},
    {"softhand/v1/simulated_skeleton", &softhand_v1_Skeleton_desc, print_skeleton},
    {"softhand/v1/tissue_surface", &softhand_v1_TissueSurface_desc, print_nothing},
    {"softhand/v1/contacts", &softhand_v1_Contacts_desc, print_contacts},
    {"softhand/v1/skin_traction", &softhand_v1_SkinTraction_desc, print_traction},
    {"softhand/v1/objects", &softhand_v1_WorldObjects_desc, print_objects},
    {"softhand/v1/object_coupling", &softhand_v1_ObjectCoupling_desc, print_nothing},
    {"softhand/v1/bone_wrench", &softhand_v1_BoneWrench_desc, print_wrench},
    {"softhand/v1/device_state", &softhand_v1_DeviceState_desc, print_nothing},
    {"softhand/v1/head_pose", &softhand_v1_HeadPose_desc, print_nothing},
    {"softhand/v1/message", &softhand_v1_Message_desc, print_nothing},
    {"softhand/v1/message_reply", &softhand_v1_MessageReply_desc, print_nothing},
    {"softhand/v1/loop_status", &softhand_v1_LoopStatus_desc, print_status},
    {"softhand/v1/rig_choices", &softhand_v1_RigChoices_desc, print_choices},
    {"softhand/v1/clock_beacon", &softhand_v1_ClockBeacon_desc, print_nothing},
    {"softhand/v1/object_description", &softhand_v1_ObjectDescription_desc, print_nothing},
    {"softhand/v1/object_joint", &softhand_v1_ObjectJointDescription_desc, print_nothing},
    {"softhand/v1/soft_object_description", &softhand_v1_SoftObjectDescription_desc, print_nothing},
    {"softhand/v1/soft_object_state", &softhand_v1_SoftObjectState_desc, print_soft_object},
    {"softhand/v1/soft_object_copy", &softhand_v1_SoftObjectState_desc, print_soft_object},
    {"softhand/v1/hand_description", &softhand_v1_HandDescription_desc, print_nothing},
};

/* Prints the module of the first writer of the topic whose user data has another hash. */
static void print_other_definition(dds_entity_t writers, const char* topic, const char* hash) {
  void* found[1] = {NULL};
  dds_sample_info_t info;
  while (dds_take(writers, found, &info, 1, 1) == 1) {
    const dds_builtintopic_endpoint_t* endpoint = found[0];
    void* data = NULL;
    size_t size = 0;
    if (info.valid_data && strcmp(endpoint->topic_name, topic) == 0 && dds_qget_userdata(endpoint->qos, &data, &size)) {
      char text[256], other[17], module[64];
      snprintf(text, sizeof text, "%.*s", (int)size, data == NULL ? "" : (const char*)data);
      if (sscanf(text, "softhand 1 %*u %16s %63[^\n]", other, module) == 2 && strcmp(other, hash) != 0)
        printf("other_definition %s\n", module);
      dds_free(data);
    }
    dds_return_loan(writers, found, 1);
    found[0] = NULL;
  }
}

int main(int argc, char** argv) {
  if (argc != 3 && argc != 4) return 2;
  size_t k = 0;
  while (k < sizeof kinds / sizeof kinds[0] && strcmp(kinds[k].topic, argv[2]) != 0) ++k;
  if (k == sizeof kinds / sizeof kinds[0]) return 2;
  const int exclusive = strcmp(argv[2], "softhand/v1/tracked_skeleton") == 0;

  const dds_entity_t participant = dds_create_participant((dds_domainid_t)atoi(argv[1]), NULL, NULL);
  const dds_entity_t topic = dds_create_topic(participant, kinds[k].type, argv[2], NULL, NULL);
  dds_qos_t* read_qos = dds_create_qos();
  dds_qset_reliability(read_qos, DDS_RELIABILITY_BEST_EFFORT, 0);
  char user_data[128] = "";
  if (argc == 4) snprintf(user_data, sizeof user_data, "softhand 1\n1\n%s\ncyclone_subscriber", argv[3]);
  dds_qset_userdata(read_qos, user_data, strlen(user_data));
  if (exclusive) dds_qset_ownership(read_qos, DDS_OWNERSHIP_EXCLUSIVE);
  const dds_entity_t reader = dds_create_reader(participant, topic, read_qos, NULL);
  const dds_entity_t writers = dds_create_reader(participant, DDS_BUILTIN_TOPIC_DCPSPUBLICATION, NULL, NULL);

  char echo_name[128];
  snprintf(echo_name, sizeof echo_name, "%s_echo", argv[2]);
  const dds_entity_t echo_topic = dds_create_topic(participant, kinds[k].type, echo_name, NULL, NULL);
  dds_qos_t* write_qos = dds_create_qos();
  dds_qset_reliability(write_qos, DDS_RELIABILITY_RELIABLE, DDS_MSECS(100));
  dds_qset_durability(write_qos, DDS_DURABILITY_TRANSIENT_LOCAL);
  dds_qset_userdata(write_qos, user_data, strlen(user_data));
  if (exclusive) {
    dds_qset_ownership(write_qos, DDS_OWNERSHIP_EXCLUSIVE);
    dds_qset_deadline(write_qos, DDS_MSECS(50));
    dds_qset_liveliness(write_qos, DDS_LIVELINESS_AUTOMATIC, DDS_MSECS(50));
  }
  const dds_entity_t writer = dds_create_writer(participant, echo_topic, write_qos, NULL);
  if (participant < 0 || topic < 0 || reader < 0 || echo_topic < 0 || writer < 0) {
    fprintf(stderr, "cyclone_subscriber: cannot create its entities (%d %d %d %d %d)\n", participant, topic, reader,
            echo_topic, writer);
    return 1;
  }

  void* sample[1] = {NULL};
  dds_sample_info_t info;
  for (int tries = 0; tries < 2000; ++tries) {
    if (dds_take(reader, sample, &info, 1, 1) == 1) {
      if (info.valid_data) break;
      dds_return_loan(reader, sample, 1);
      sample[0] = NULL;
    }
    dds_sleepfor(DDS_MSECS(10));
  }
  if (sample[0] == NULL || !info.valid_data) return 1;
  if (argc == 4) print_other_definition(writers, argv[2], argv[3]);
  kinds[k].print(sample[0]);
  fflush(stdout);
  struct pollfd input = {.fd = 0, .events = POLLIN};
  for (int tries = 0; tries < 1000; ++tries) {
    if (dds_write(writer, sample[0]) != DDS_RETCODE_OK) return 1;
    if (poll(&input, 1, 20) > 0) break; /* closed */
  }
  dds_dispose(writer, sample[0]);
  dds_delete(participant);
  return 0;
}
