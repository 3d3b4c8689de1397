/* cyclone_peer DOMAIN read|write TOPIC SECONDS: a program on Cyclone DDS in a secured domain. Prints `samples N` after
   it has read, or `readers N` after it has written. TOPIC is simulated_skeleton or bone_wrench. */
#include <dds/dds.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bone_wrench.h"
#include "skeleton.h"

int main(int argc, char** argv) {
  if (argc != 5) return 2;
  const int is_wrench = strcmp(argv[3], "bone_wrench") == 0;
  char name[64];
  snprintf(name, sizeof name, "softhand/v1/%s", argv[3]);
  const dds_entity_t participant = dds_create_participant((dds_domainid_t)atoi(argv[1]), NULL, NULL);
  if (participant < 0) {
    fprintf(stderr, "cyclone_peer: cannot join the domain: %s\n", dds_strretcode(participant));
    return 3;
  }
  const dds_topic_descriptor_t* type = is_wrench ? &softhand_v1_BoneWrench_desc : &softhand_v1_Skeleton_desc;
  const dds_entity_t topic = dds_create_topic(participant, type, name, NULL, NULL);
  dds_qos_t* qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_BEST_EFFORT, 0);
  const int reads = strcmp(argv[2], "read") == 0;
  const dds_entity_t endpoint =
      reads ? dds_create_reader(participant, topic, qos, NULL) : dds_create_writer(participant, topic, qos, NULL);
  if (topic < 0 || endpoint < 0) {
    fprintf(stderr, "cyclone_peer: cannot %s %s: %s\n", argv[2], name, dds_strretcode(topic < 0 ? topic : endpoint));
    return 4;
  }
  unsigned most = 0, samples = 0;
  softhand_v1_BoneWrench* wrench = calloc(1, sizeof *wrench);
  softhand_v1_Skeleton* skeleton = calloc(1, sizeof *skeleton);
  wrench->hand.side = skeleton->hand.side = 1;
  for (int tries = 0; tries < 100 * atoi(argv[4]); ++tries) {
    dds_sleepfor(DDS_MSECS(10));
    if (reads) {
      void* sample[1] = {NULL};
      dds_sample_info_t info;
      while (dds_take(endpoint, sample, &info, 1, 1) == 1) {
        samples += info.valid_data ? 1 : 0;
        dds_return_loan(endpoint, sample, 1);
        sample[0] = NULL;
      }
    } else {
      dds_publication_matched_status_t status;
      dds_get_publication_matched_status(endpoint, &status);
      if (status.current_count > most) most = status.current_count;
      dds_write(endpoint, is_wrench ? (void*)wrench : (void*)skeleton);
    }
  }
  printf(reads ? "samples %u\n" : "readers %u\n", reads ? samples : most);
  dds_delete(participant);
  return 0;
}
