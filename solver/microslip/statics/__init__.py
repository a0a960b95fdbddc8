"""What the joint carries before it vibrates: contact at rest under constant loads, in load steps."""
