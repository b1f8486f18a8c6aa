"""Where each row of the behaviour table is proven: section -> row -> tests, or the later work that a row belongs to.

`starting::a_silent_stream` is `tests/behaviour/test_starting.py::test_a_silent_stream`; `core/gate::x` is
`tests/core/test_gate.py::test_x`; `cells::take` is that row of the table in `test_transitions.py`. `test_index.py` checks
that all of them exist, and that no test of this folder stands outside.
"""

from __future__ import annotations

__all__ = ["INDEX", "LATER"]

LATER = "later: "
"""Begins what stands in place of tests while a row belongs to later work."""

POSES, GRIPPER, GROUND = f"{LATER}poses", f"{LATER}gripper", f"{LATER}chassis and lift drive"
WRITERS, GUARD, LINK, CLIENT = f"{LATER}foreign writers", f"{LATER}guard", "tests/link, tests/e2e", "tests/client"

VALUES = {
    "arm joint v / a / j": (
        "motions::a_speed_factor_scales_the_velocity",
        "streaming::tighter_limits_of_the_configuration_hold",
        "streaming::targets_of_any_rate_become_a_smooth_100_hz_stream",
    ),
    "pose speed": POSES,
    "chassis": GROUND,
    "settle": (
        "motions::a_motion_settles_for_0_5_s_within_its_tolerance",
        "motions::a_motion_that_does_not_settle_is_aborted",
        "motions::a_motion_to_where_the_arm_is_held_is_reached_after_settling",
    ),
    "tracking error that aborts": (
        "robot_side::an_arm_that_does_not_follow_is_latched_after_0_3_s",
        "robot_side::a_moment_away_from_the_setpoint_is_no_tracking_error",
    ),
    "jump allowed at a chunk's first point": f"{LATER}chunks",
    "expiry of a target": (
        "streaming::a_target_without_a_successor_expires",
        "streaming::an_expiry_outside_its_bounds_is_refused",
    ),
    "fresh, link": ("losing_the_link::stale_is_entered_when_the_newest_state_is_older_than_100_ms",),
    "fresh, part": ("cells::part dead", "enabling::enable_is_refused_while_an_arms_state_is_dead"),
    "`fsm_state` valid": (
        "cells::fsm dead",
        "robot_side::a_robot_whose_fsm_is_not_heard_is_held_in_pause",
        "enabling::enable_is_refused_while_fsm_state_is_not_heard",
    ),
    "`current_mode` valid": (
        "cells::mode unknown",
        "enabling::enable_is_refused_while_the_mode_is_not_known",
    ),
    "client keepalive lost": ("losing_clients::a_client_is_lost_after_250_ms_without_a_keepalive",),
    "lease free after client loss / everything down": (
        "losing_clients::a_lost_client_keeps_the_lease_for_10_s_and_the_hold_for_60_s",
        "losing_clients::a_client_lost_while_nothing_is_held_costs_only_its_lease",
    ),
    "ENABLING": (
        "enabling::an_enabling_lasts_at_most_10_s_and_says_what_was_missing",
        "enabling::an_enabling_without_steady_state_says_so_and_sends_nothing",
        "enabling::every_way_out_of_enabling_names_its_reason",
    ),
    "a start outside limits": (
        "starting::a_start_just_outside_the_limits_begins_at_the_limit_and_says_so",
        "starting::a_start_far_outside_the_limits_refuses_enable",
        "starting::an_arm_that_leaves_its_limits_before_it_is_seeded_ends_the_enabling",
    ),
    "speed factors": (
        "motions::a_speed_factor_scales_the_velocity",
        "motions::a_slower_motion_in_mid_motion_does_not_run_away",
        "streaming::a_streams_speed_factor_scales_the_velocity",
    ),
    "own time grids": ("core/streams/grid::intervals_have_one_length_at_any_uptime",),
}

TRANSITIONS = {
    "acquire (free)": (
        "losing_clients::whoever_acquires_an_unowned_hold_goes_on_from_it",
        "losing_clients::of_two_who_acquire_at_once_one_gets_the_lease",
        "losing_clients::who_acquires_a_free_lease_gets_it_in_every_state",
    ),
    "take": ("cells::take", "losing_clients::the_owner_who_takes_what_he_owns_changes_nothing"),
    "release": ("cells::release", "stopping::disable_and_release_brake_first_and_then_pause_the_robot"),
    "disable": ("cells::disable", "stopping::disable_and_release_brake_first_and_then_pause_the_robot"),
    "enable": ("cells::enable",),
    "arm motion": ("cells::arm motion",),
    "chassis, lift command": GROUND,
    "owner's stop": ("cells::owner's stop", "stopping::only_somebody_elses_stop_latches"),
    "other's stop": ("cells::other's stop", "stopping::only_somebody_elses_stop_latches"),
    "estop": ("cells::estop", "stopping::an_estop_sends_everything_at_once_and_latches"),
    "recover": ("cells::recover", "stopping::recover_clears_all_causes_and_changes_nothing_else"),
    "client lost": (
        "cells::client lost",
        "losing_clients::a_client_whose_token_is_gone_is_lost_at_once",
        "losing_clients::a_client_that_leaves_its_lease_is_lost_at_once",
        "losing_clients::a_lost_client_while_stopping_is_still_stopped",
    ),
    "client back < 10 s": (
        "losing_clients::a_client_that_is_back_within_10_s_ends_the_clocks",
        "losing_clients::a_keepalive_of_another_client_ends_no_clock",
    ),
    "lease free": ("losing_clients::a_lost_client_keeps_the_lease_for_10_s_and_the_hold_for_60_s",),
    "60 s": (
        "losing_clients::a_lost_client_keeps_the_lease_for_10_s_and_the_hold_for_60_s",
        "losing_clients::after_60_s_the_lift_is_off",
    ),
    "stale": ("cells::stale",),
    "fresh": (
        "losing_the_link::a_short_stall_resumes_into_holding_without_a_gap",
        "losing_the_link::after_a_long_stall_0_0_is_sent_only_when_the_robot_is_known_to_be_ours",
    ),
    "transport lost": ("cells::transport lost",),
    "FSM READY": ("cells::FSM READY", "robot_side::somebody_who_enables_a_paused_robot_is_paused"),
    "FSM 0 or 1": (
        "cells::FSM 0",
        "cells::FSM 1",
        "robot_side::an_enabled_robot_that_falls_back_while_enabling_is_paused_again",
        "robot_side::a_pause_while_stopping_is_what_was_asked_for",
        "robot_side::a_paused_owner_can_still_go_down_when_0_0_found_no_hearing",
    ),
    "FSM ERROR": (
        "cells::FSM ERROR",
        "robot_side::an_fsm_error_sends_0_0_and_latches",
        "robot_side::an_error_that_shows_only_while_stale_is_latched_after_our_own_1_0",
    ),
    "FSM 3-6, unknown value": (
        "cells::FSM 3",
        "cells::FSM 9",
        "robot_side::a_robot_that_plays_or_is_driven_by_vr_gets_nothing",
    ),
    "fsm_state dead": (
        "cells::fsm dead",
        "losing_the_link::an_fsm_that_falls_silent_while_seeding_ends_it_with_0_0",
    ),
    "VR mode": ("cells::VR mode", "robot_side::vr_mode_gets_no_arm_frame_no_1_0_and_no_0_0"),
    "API mode again": ("losing_the_link::a_0_0_that_is_owed_is_paid_when_vr_mode_ends",),
    "one arm disabled": (
        "cells::arm disabled",
        "enabling::the_other_arm_goes_on_after_one_was_disabled",
        "enabling::an_arm_that_is_disabled_while_enabling_is_left_out",
    ),
    "no arm enabled": (
        "cells::no arm",
        "enabling::enable_needs_an_enabled_arm_in_joint_mode",
        "robot_side::the_last_arm_that_leaves_joint_mode_takes_everything_down",
        "robot_side::the_last_streamed_arm_that_is_disabled_takes_everything_down",
    ),
    "one part's state dead": ("cells::part dead",),
    "tracking error": (
        "cells::tracking error",
        "starting::motion_is_refused_until_a_strayed_arm_has_been_walked_back_to",
    ),
    "foreign token or publisher": WRITERS,
    "foreign arm or fsm data": WRITERS,
    "other gateway armed": WRITERS,
    "SIGTERM": (
        "cells::SIGTERM",
        "ending::sigterm_ends_in_less_than_5_s_with_0_0",
        "ending::sigterm_in_the_middle_of_a_brake_brakes_on",
        "ending::sigterm_with_slow_brakes_pauses_the_robot_in_time",
        "ending::nothing_is_accepted_any_more_once_the_end_was_asked_for",
    ),
    "daemon dead: the guard": GUARD,
    "suspend and resume": (
        "cells::suspend",
        "time::a_suspend_frees_the_lease_and_takes_everything_down",
        "time::a_suspend_that_finds_only_old_state_holds_nothing_either",
    ),
    "(names in another order)": ("cells::joint order",),
    "(the table is whole)": ("transitions::every_event_is_judged_in_every_state_or_said_to_be_impossible",),
}

STARTING = {
    "a silent stream starts": (
        "starting::a_silent_stream_starts_from_the_measured_state",
        "starting::the_robot_is_ready_before_any_setpoint_differs_from_the_echo",
        "starting::the_first_heartbeat_comes_after_the_first_setpoints",
    ),
    "a live stream goes on": (
        "starting::holding_goes_on_from_its_last_setpoint_however_often",
        "starting::a_new_owner_goes_on_from_the_last_setpoint",
        "starting::ready_goes_on_from_the_echo",
    ),
    "walk": (
        "starting::a_reference_that_lost_its_arm_walks_back_and_the_grip_is_kept",
        "starting::nothing_walks_while_the_arms_are_where_they_are_held",
        "starting::an_arm_far_outside_its_limits_cannot_be_walked_to",
        "starting::a_stop_ends_a_walk",
    ),
    "before seeding after any stall, reconnect or own pause": (
        "starting::seeding_demands_0_3_s_of_samples_after_a_reconnect",
        "starting::seeding_starts_anew_after_our_own_pause",
        "starting::queued_old_states_do_not_seed",
        "starting::a_pause_is_left_without_a_gap_and_from_the_measured_state",
    ),
    "a part's state comes back while the link was fresh": (
        "starting::an_arm_whose_state_comes_back_while_the_link_was_fresh_is_not_seeded",
    ),
    "gripper": GRIPPER,
    "two arms in one motion, one is lost": (
        "enabling::a_motion_of_two_arms_ends_for_both_when_one_is_lost",
        "enabling::an_arm_is_lost_by_its_own_code_when_both_are_lost",
    ),
    "two gateways or owners `acquire` at once": ("losing_clients::of_two_who_acquire_at_once_one_gets_the_lease",),
    "`enable` when ENABLING or ACTIVE; FSM 1-2 without our 1.0": (
        "enabling::enable_succeeds_when_it_is_under_way_or_done_and_sends_nothing",
        "enabling::enable_is_refused_while_the_fsm_is_not_in_pause",
        "enabling::enable_waits_until_the_last_0_0_was_heard",
        "enabling::an_enabling_ends_when_somebody_else_enables_first",
    ),
}

STOPPING = {
    "chassis zeros, lift stop, 0.0": (
        "stopping::a_stop_is_never_refused_and_stops_chassis_and_lift_at_once",
        "stopping::0_0_is_repeated_at_20_hz_until_fsm_0_is_seen",
        "stopping::0_0_that_is_not_heard_ends_after_2_s_and_is_told_once",
        "stopping::without_transport_the_reply_says_that_the_stop_was_not_delivered",
        "stopping::an_estop_without_transport_is_sent_again_when_the_robot_is_back",
        "stopping::an_estop_that_was_heard_is_not_sent_again_after_a_later_stall",
        "stopping::an_estop_that_was_cut_short_by_a_loss_is_sent_again",
        "stopping::recover_ends_the_repetition_of_an_estop_that_was_not_heard",
        "time::a_late_tick_still_sends_stop_frames",
    ),
    "plain stop": (
        "stopping::a_plain_stop_does_not_send_0_0",
        "stopping::a_stop_ends_motions_and_streams_with_its_code",
        "stopping::a_model_without_a_lift_gets_no_lift_frames",
    ),
    "(requests from before a stop)": (
        "stopping::what_was_asked_before_a_stop_is_refused_after_it",
        "stopping::a_target_from_before_a_stop_moves_nothing",
        "stopping::a_repeated_request_gets_its_first_reply_again",
        "stopping::a_stop_stops_even_under_a_number_that_was_used_before",
    ),
    "lift": (
        "stopping::release_takes_the_lift_off_after_a_stop",
        "stopping::an_estop_sends_everything_at_once_and_latches",
        "losing_clients::after_60_s_the_lift_is_off",
        "ending::sigterm_ends_in_less_than_5_s_with_0_0",
    ),
    "estop": (
        "stopping::an_estop_sends_everything_at_once_and_latches",
        "stopping::an_estop_goes_on_when_the_robot_is_switched_to_vr_mode",
    ),
    "`recover`": (
        "stopping::recover_clears_all_causes_and_changes_nothing_else",
        "stopping::recover_clears_none_while_a_cause_persists",
        "stopping::after_recover_the_hold_goes_on_and_motion_is_allowed",
    ),
    "latches, epoch, own zid": (
        "ending::latches_survive_a_restart_of_the_daemon",
        "ending::an_epoch_is_never_reused",
        "ending::a_remembered_estop_is_sent_again_only_where_it_is_needed",
    ),
    "`with control()` ends normally": CLIENT,
    "(hold and cancel)": ("stopping::hold_and_cancel_keep_the_lease_the_state_and_the_heartbeat",),
    '`on_loss="pause"`': ("cells::lost, pause", "losing_clients::on_loss_pause_goes_down_at_once"),
    "takeover in mid-motion": (
        "losing_clients::a_takeover_in_mid_motion_brakes_first",
        "losing_clients::a_takeover_of_a_brake_waits_for_it_too",
        "losing_clients::a_late_command_of_a_former_owner_moves_nothing",
    ),
    "`acquire` by others while the clocks run": (
        "losing_clients::while_the_clocks_run_others_take_but_do_not_acquire",
    ),
    "stale": (
        "losing_the_link::stale_is_entered_when_the_newest_state_is_older_than_100_ms",
        "losing_the_link::at_rest_constant_frames_go_on_for_at_most_0_8_s",
        "losing_the_link::the_hold_in_stale_ends_at_once_with_whatever_would_end_holding",
        "losing_the_link::a_stop_in_stale_does_not_end_the_hold",
        "losing_the_link::a_burst_after_a_stall_of_the_link_moves_nothing",
    ),
    "short stall": (
        "losing_the_link::a_short_stall_resumes_into_holding_without_a_gap",
        "losing_the_link::a_short_stall_in_motion_resumes_from_where_the_arms_are",
        "losing_the_link::a_stall_within_a_short_stall_is_one_stall",
        "losing_the_link::a_short_stall_needs_an_fsm_sample_that_came_after_it_began",
        "losing_the_link::a_short_stall_in_which_the_robot_paused_is_not_resumed",
        "losing_the_link::an_fsm_that_falls_silent_while_seeding_ends_it_with_0_0",
        "losing_the_link::an_arm_that_stays_silent_after_a_short_stall_ends_the_way_back",
        "losing_the_link::a_stall_from_pause_or_enabling_is_not_resumed",
        "losing_the_link::a_backlog_that_still_says_ready_does_not_restart_a_robot_that_was_stopped_meanwhile",
        "losing_the_link::a_1_0_that_was_wrong_after_a_short_stall_is_taken_back_at_once",
    ),
    "0.0 after a loss": (
        "losing_the_link::after_a_long_stall_0_0_is_sent_only_when_the_robot_is_known_to_be_ours",
        "losing_the_link::after_a_long_stall_nothing_is_sent_to_a_robot_that_is_somebody_elses",
        "losing_the_link::a_0_0_that_is_owed_is_paid_when_vr_mode_ends",
    ),
    "transport lost": (
        "losing_the_link::a_lost_transport_ends_everything_and_a_reconnect_re_arms_nothing",
        "losing_the_link::another_transport_is_a_lost_one",
        "losing_the_link::a_transport_that_is_back_in_the_same_tick_was_lost_all_the_same",
    ),
    "wall clock jumps": (
        "time::a_jump_of_the_robots_clock_changes_nothing",
        "time::enabling_works_after_a_jump_of_the_robots_clock",
    ),
    "own suspend": (
        "time::a_suspend_frees_the_lease_and_takes_everything_down",
        "time::what_was_heard_before_a_sleep_is_not_believed_after_it",
    ),
    "tick late > 50 ms": (
        "time::a_tick_that_is_more_than_50_ms_late_is_skipped_and_told",
        "time::after_a_gap_in_which_the_robot_stopped_the_arms_the_motion_is_over",
        "motions::a_skipped_tick_delays_a_motion_and_does_not_compress_it",
    ),
}

ROBOT_SIDE = {
    "PAUSE, or READY -> SLOW_START": (
        "robot_side::a_robot_that_pauses_by_itself_is_held_in_pause",
        "robot_side::a_pause_too_short_to_be_seen_is_a_pause",
    ),
    "MODE_UNKNOWN": ("robot_side::an_unknown_mode_brakes_and_refuses_motion",),
    "VR mode, FSM 3-6": (
        "robot_side::vr_mode_gets_no_arm_frame_no_1_0_and_no_0_0",
        "robot_side::a_robot_that_plays_or_is_driven_by_vr_gets_nothing",
    ),
    "an arm is enabled again": (
        "enabling::an_arm_that_is_enabled_again_joins_only_at_the_next_enable",
        "enabling::an_arm_joins_only_from_a_steady_state",
    ),
    "(mixed control modes)": ("enabling::only_arms_that_are_enabled_in_joint_mode_are_streamed",),
    "measured jump, NaN, wrong length": (
        "robot_side::samples_that_cannot_be_believed_are_counted_and_the_part_goes_dead_if_they_last",
    ),
    "names in another order than §4.0.3": ("robot_side::joint_names_in_another_order_are_latched",),
    "robot restarted (new router zid)": ("losing_the_link::another_transport_is_a_lost_one",),
    "FSM ERROR or foreign token while nothing of ours ran": (
        "robot_side::an_fsm_error_while_nothing_of_ours_ran_is_a_condition",
    ),
    "(people hear of it once)": ("robot_side::what_lasts_is_told_once",),
}

BRIDGE = {
    "state dead, transport up, tokens there, admin shows no DDS reader": LINK,
    "state dead, transport up, tokens gone": LINK,
    "state N times": (
        "core/duplication::every_sample_three_times_is_told_once_with_the_count",
        "core/engine::a_bridge_that_delivers_everything_twice_is_told_once",
    ),
    "1.0 out > 1.5 s, FSM stays PAUSE": (
        "enabling::a_heartbeat_that_does_nothing_is_told_once_with_what_is_known_of_its_way",
    ),
}

MOTIONS = {
    "point to point": (
        "motions::a_motion_is_queued_then_executed_with_progress_then_reached",
        "motions::all_joints_of_both_arms_end_together",
        "motions::a_relative_motion_counts_from_the_reference",
        "motions::a_motion_that_cannot_be_is_refused_and_the_running_one_goes_on",
        "motions::a_motion_that_finds_no_path_leaves_the_running_one_alone",
        "motions::clipping_is_opt_in_and_reported",
        "motions::a_later_motion_supersedes_the_earlier_one_without_a_stop",
        "motions::each_arm_may_have_a_motion_of_its_own",
    ),
    "streamed targets": (
        "streaming::targets_of_any_rate_become_a_smooth_100_hz_stream",
        "streaming::a_stream_starts_at_the_present_reference",
        "streaming::targets_outside_the_limits_are_refused_or_clipped_as_asked",
        "streaming::a_target_that_is_no_target_is_refused",
        "streaming::an_older_target_is_never_followed",
        "streaming::another_client_cannot_push_a_target_out_of_its_slot",
        "streaming::a_target_under_another_epoch_is_refused",
        "streaming::a_stream_that_ended_takes_no_targets_and_says_why",
        "streaming::a_stream_takes_its_arm_out_of_a_motion_of_two",
        "streaming::a_stream_says_when_its_targets_ask_for_too_much",
    ),
}

INDEX: dict[str, dict[str, tuple[str, ...] | str]] = {
    "Values": VALUES,
    "Transitions": TRANSITIONS,
    "Starting and continuing": STARTING,
    "Stopping and losing": STOPPING,
    "The guard": {"all of it": GUARD},
    "The robot does something by itself": ROBOT_SIDE,
    "The bridge misbehaves": BRIDGE,
    "Somebody else": {"all of it": WRITERS},
    "What the owner moves": MOTIONS,
}
"""Section -> row -> tests; a text instead names the later work, or the folder, that has the row. Rows in brackets are
not the behaviour table's own: they stand beside it."""
