"""What leaves the companion, and what may be asked of it, in four rooms.

| room     | files                                                                           |
|----------|---------------------------------------------------------------------------------|
| words    | `modes`, `glossary`: states, conditions, who steers; `status_line`, `event_log` |
| schemas  | `fields`, `ranges`; `schemas`: keys and records; `samples`: a tick as records   |
| commands | `commands`, `plan`: a path; `path_files`: where it comes from; `degrees`        |
| session  | `session`: Zenoh, configured and kept open                                      |

A new field touches `schemas`, the record that has it (companion.records) and what computes it; a key of the
configuration companion.config and its user (tuned live: `commands` too); a
condition companion.records.conditions, companion.supervision.rules and a test. The rest is generated.
"""
