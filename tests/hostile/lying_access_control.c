/* A member of a secured domain that has thrown its own access control away: the shipped plugin, except that
 * whatever this participant wants to create or match, it allows itself. What the others think of it is
 * theirs. Its identity and permissions stay the signed ones: those it cannot change. */
#include <dds/security/dds_security_api.h>
#include <dlfcn.h>
#include <stddef.h>

static void* library;

static DDS_Security_boolean yes_create_writer(dds_security_access_control* a,
                                              const DDS_Security_PermissionsHandle p,
                                              const DDS_Security_DomainId d, const DDS_Security_char* topic,
                                              const DDS_Security_Qos* q,
                                              const DDS_Security_PartitionQosPolicy* partition,
                                              const DDS_Security_DataTags* tag,
                                              DDS_Security_SecurityException* ex) {
  (void)a, (void)p, (void)d, (void)topic, (void)q, (void)partition, (void)tag, (void)ex;
  return 1;
}

static DDS_Security_boolean yes_create_reader(dds_security_access_control* a,
                                              const DDS_Security_PermissionsHandle p,
                                              const DDS_Security_DomainId d, const DDS_Security_char* topic,
                                              const DDS_Security_Qos* q,
                                              const DDS_Security_PartitionQosPolicy* partition,
                                              const DDS_Security_DataTags* tag,
                                              DDS_Security_SecurityException* ex) {
  (void)a, (void)p, (void)d, (void)topic, (void)q, (void)partition, (void)tag, (void)ex;
  return 1;
}

static DDS_Security_boolean yes_create_topic(dds_security_access_control* a,
                                             const DDS_Security_PermissionsHandle p,
                                             const DDS_Security_DomainId d, const DDS_Security_char* topic,
                                             const DDS_Security_Qos* q, DDS_Security_SecurityException* ex) {
  (void)a, (void)p, (void)d, (void)topic, (void)q, (void)ex;
  return 1;
}

int init_access_control(const char* argument, void** context, struct ddsi_domaingv* gv) {
  library = dlopen(REAL_PLUGIN, RTLD_NOW);
  plugin_init init = library ? (plugin_init)dlsym(library, "init_access_control") : NULL;
  const int code = init ? init(argument, context, gv) : -1;
  if (code == 0) {
    dds_security_access_control* plugin = *context;
    plugin->check_create_datawriter = yes_create_writer;
    plugin->check_create_datareader = yes_create_reader;
    plugin->check_create_topic = yes_create_topic;
  }
  return code;
}

int finalize_access_control(void* context) {
  plugin_finalize finalize = (plugin_finalize)dlsym(library, "finalize_access_control");
  return finalize ? finalize(context) : -1;
}
